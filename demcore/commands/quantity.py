"""Numbers with a unit as a person writes them: 50us, 0.03 m/s, 30mm/s. Without a unit they are refused."""

from __future__ import annotations

import math
import re

from demcore.errors import InputError

UNITS = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
    "speed": {"m/s": 1.0, "mm/s": 1e-3, "cm/s": 1e-2},
}
EXAMPLES = {"time": "50us or 0.05s", "speed": "30mm/s or 0.03m/s"}
NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?:nan|inf))\s*(\S*)\s*")


def parse_quantity(field: str, text: str, dimension: str) -> float:
    """The positive value of `text` in SI units. Raises InputError for no number, no unit or another one."""
    allowed = f"a positive number with its unit ({', '.join(UNITS[dimension])}), as in {EXAMPLES[dimension]}"
    match = NUMBER.fullmatch(text)
    if match is None or match[2] not in UNITS[dimension]:
        raise InputError(field, text, allowed)
    value = float(match[1]) * UNITS[dimension][match[2]]
    if not (math.isfinite(value) and value > 0.0):
        raise InputError(field, text, allowed)
    return value

"""Replicates that are copies: the same numbers twice are one experiment, and would understate the noise.

Two replicates are copies when they agree in all that both of them observed, to rounding, and when what they agree
in holds more digits than chance would give: five significant digits within one condition, eight across conditions.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from service.domain.data_set.records import Observation

Place = tuple[str, str]
DIGITS_WITHIN, DIGITS_ACROSS = 5, 8
_SAME = 1e-9


def significant_digits(value: float) -> int:
    """Digits that a measured number carries: 0.0312 has three, 1200 two, 0 none."""
    if value == 0.0:
        return 0
    mantissa = f"{value:.9e}".lstrip("-").split("e")[0]
    return len(mantissa.replace(".", "").rstrip("0"))


def copied_replicates(observations: Iterable[Observation]) -> Iterator[tuple[Place, str]]:
    """Each replicate that repeats an earlier one, with the sentence that says which."""
    values: dict[Place, dict[str, float]] = {}
    for o in observations:
        values.setdefault((o.condition, o.replicate), {})[o.observable] = o.value
    earlier: dict[tuple[str, float], list[Place]] = {}
    for place, mine in values.items():
        candidates: dict[Place, None] = {}
        for name, value in mine.items():
            near = earlier.setdefault((name, float(f"{value:.6e}")), [])
            candidates |= dict.fromkeys(near)
            near.append(place)
        for other in candidates:
            if _is_copy(mine, values[other], place[0] == other[0]):
                yield place, f"an experiment of its own; it repeats replicate {other[1]} of {other[0]}"
                break


def _is_copy(mine: dict[str, float], other: dict[str, float], same_condition: bool) -> bool:
    shared = [name for name in mine if name in other]
    if not all(math.isclose(mine[n], other[n], rel_tol=_SAME) for n in shared):
        return False
    digits = sum(significant_digits(mine[n]) for n in shared)
    return digits >= (DIGITS_WITHIN if same_condition else DIGITS_ACROSS)

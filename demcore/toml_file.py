"""TOML files that a user wrote: read whole, small, with refusals that name the field and its unit."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Collection
from pathlib import Path
from typing import Any

from demcore.errors import InputError

LARGEST_FILE = 2**20


def read_toml(field: str, path: Path) -> dict[str, Any]:
    """The tables of a file. Raises InputError, naming `field`, for one that cannot be read or is no TOML."""
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise InputError(field, str(path), f"a file of at most {LARGEST_FILE} bytes")
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(field, str(path), f"a file that can be read ({error.strerror})") from None
    except (ValueError, RecursionError) as error:
        # TOMLDecodeError and UnicodeDecodeError are ValueErrors; a number of over 4,300 digits is one by itself.
        raise InputError(field, str(path), f"a TOML file ({error})") from None


def refuse_unknown(field: str, key: str, value: Any, known: Collection[str]) -> None:
    """Raises InputError for a key that is not known; one that only lacks its unit is told which."""
    if key in known:
        return
    with_unit = sorted(k for k in known if k.startswith(f"{key}_"))
    if with_unit:
        raise InputError(f"{field}.{key}", value, f"{with_unit[0]}: a number says its unit in its name")
    raise InputError(f"{field}.{key}", value, "a known key: " + ", ".join(known))


def number(field: str, value: Any, otherwise: str = "") -> float:
    """A finite number. Raises InputError, telling what is allowed `otherwise` too."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not _is_finite(value):
        raise InputError(field, value, "a number" + otherwise)
    return value


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond all floats
        return False

"""What an input may be: each check raises InputError with the field, the value and what is allowed."""

from __future__ import annotations

import math
import numbers
from collections.abc import Sequence

import numpy as np

from demcore.errors import InputError

Triple = tuple[float, float, float]


def _is_number(value: object) -> bool:
    # True and False are integers to Python, and never meant as a length or a seed.
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def within(field: str, value: float, lower: float, upper: float, unit: str = "") -> None:
    """A finite number from `lower` to `upper`, both allowed."""
    if not (_is_number(value) and math.isfinite(value) and lower <= value <= upper):
        raise InputError(field, value, f"{lower:g} to {upper:g} {unit}".rstrip())


def positive(field: str, value: float, unit: str) -> None:
    """A finite number above 0."""
    if not (_is_number(value) and math.isfinite(value) and value > 0.0):
        raise InputError(field, value, f"a positive number of {unit}")


def not_negative(field: str, value: float, unit: str) -> None:
    """A finite number, 0 or more."""
    if not (_is_number(value) and math.isfinite(value) and value >= 0.0):
        raise InputError(field, value, f"0 {unit} or more")


def natural(field: str, value: object) -> None:
    """A whole number, 0 or more: a seed or a count."""
    if not (isinstance(value, int | np.integer) and not isinstance(value, bool) and value >= 0):
        raise InputError(field, value, "a whole number, 0 or more")


def vector(field: str, value: Sequence[float], unit: str = "") -> None:
    """Three finite numbers."""
    if not (len(value) == 3 and all(_is_number(c) and math.isfinite(c) for c in value)):
        raise InputError(field, value, f"three finite numbers {unit}".rstrip())


def shares(field: str, values: Sequence[float]) -> None:
    """Positive shares that sum to 1 within 1e-6."""
    for value in values:
        if not (_is_number(value) and math.isfinite(value) and value > 0.0):
            raise InputError(field, value, "more than 0 (leave an empty part out)")
    if abs(math.fsum(values) - 1.0) > 1e-6:
        raise InputError(field, math.fsum(values), "shares that sum to 1")


def choice(field: str, value: object, names: Sequence[str]) -> None:
    """One of `names`."""
    if value not in names:
        raise InputError(field, value, "one of " + ", ".join(names))

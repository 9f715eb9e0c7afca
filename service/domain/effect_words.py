"""Amplitudes in plant words: mm, %, degrees and multiples instead of the number that the simulation takes.

Used wherever an amplitude is read: card, pages, report and command. What an effect's number becomes stands in
effects.toml (`told`).
"""

from __future__ import annotations

import math

from service.domain.effects import DOUBLING, FACTOR_10, FACTOR_E, PERCENT, Effect, library

# What the number is multiplied by, and what stands behind it, by unit.
_UNITS = {"1": (1.0, ""), "m": (1000.0, " mm"), "deg": (1.0, " degrees")}
# Digits of a size without an interval.
_DIGITS = 2
_MOST_DECIMALS = 6


def size_in_words(effect: str, size: float, unit: str) -> str:
    """A size that an effect must have, in either direction where it has two: `0.56 or 1.8 times ...`, `±7 %`.

    `size` above 0, in `unit`; an effect that this library does not know (of an older one) keeps number and unit.
    """
    known = library()
    if effect not in known:
        return f"{size:.3g} {unit}"
    found = known[effect]
    sizes = (-size, size) if found.is_two_sided else (size,)
    if _is_factor(found):
        number = " or ".join(_of_digits(_shown(found, a), near=1.0) for a in sizes)
    else:
        sign = "±" if found.is_two_sided else ""
        number = sign + _of_digits(_shown(found, size)) + _tail(found)
    return found.told.words.format(number)


def estimate_in_words(effect: str, value: float, interval: tuple[float, float], unit: str) -> str:
    """An amplitude with its interval: `2.0 (1.6 to 2.5) times the stated lift speed`.

    All in `unit`; an effect that this library does not know (of an older one) keeps numbers and unit.
    """
    known = library()
    if effect not in known:
        return f"{value:.3g} ({interval[0]:.3g} to {interval[1]:.3g}) {unit}"
    found = known[effect]
    middle, low, high = (_shown(found, a) for a in (value, *interval))
    decimals = _decimals_within(0.5 * abs(high - low))
    sign = "+" if found.is_two_sided and not _is_factor(found) else ""
    middle_text, low_text, high_text = (_rounded(x, decimals, sign) for x in (middle, low, high))
    tail = _tail(found)
    behind = tail if tail == " %" else ""
    return found.told.words.format(f"{middle_text}{tail} ({low_text} to {high_text}{behind})")


def _is_factor(effect: Effect) -> bool:
    return effect.told.as_ in (FACTOR_E, FACTOR_10)


def _shown(effect: Effect, amplitude: float) -> float:
    """The number that is told."""
    if effect.told.as_ == FACTOR_E:
        return math.exp(amplitude)
    if effect.told.as_ == FACTOR_10:
        return float(10.0**amplitude)
    if effect.told.as_ == PERCENT:
        return 100.0 * amplitude
    if effect.told.as_ == DOUBLING:
        return 100.0 * math.log(2.0) * amplitude
    return _UNITS[effect.unit][0] * amplitude


def _tail(effect: Effect) -> str:
    return " %" if effect.told.as_ in (PERCENT, DOUBLING) else _UNITS[effect.unit][1]


def _of_digits(number: float, near: float = 0.0) -> str:
    """So many digits; a number near `near` (a factor near 1) so many that the difference shows."""
    decimals = max(
        _DIGITS - 1 - _power(number), _decimals_within(abs(number - near)) if number != near else 0
    )
    return _rounded(number, decimals)


def _decimals_within(spread: float) -> int:
    """So many that the spread keeps a digit, two where it begins with a 1."""
    return -_power(0.5 * spread)


def _power(number: float) -> int:
    return math.floor(math.log10(abs(number))) if number else 0


def _rounded(number: float, decimals: int, sign: str = "") -> str:
    """Whole from the point on to the left. Zero has no sign."""
    text = f"{number:{sign}.{min(max(decimals, 0), _MOST_DECIMALS)}f}"
    return text if float(text) else text.lstrip("+-")

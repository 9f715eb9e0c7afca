"""How improbable it is that two experiments of their own read the same numbers.

Two readings that are rounded to a step h and scatter by sd s between replicates agree by chance with probability
h / (2 sqrt(pi) s), or surely where s is below the step. h is the coarsest grid on which the readings lie, s comes
from the replicates, and what never varies tells nothing.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Hashable, Iterable, Mapping, Sequence
from itertools import accumulate, pairwise
from typing import NamedTuple

Place = tuple[str, str]
# Of the honest data sets, so many at most may be refused.
FALSE_ALARMS = 1e-3
# Two normal numbers agree to within a small step h with the probability h times this over their sd.
_AGREE = 1.0 / (2.0 * math.sqrt(math.pi))
# Of one pile, apex and angle vary together: from the second reading on, each is taken as twice as likely to agree
# (a correlation of .87), and beyond the sixth they tell nothing new.
_TOGETHER, _MOST_COUNTED = 2.0, 6
# The mean range of n normal numbers in sd.
_RANGES = (1.128, 1.693, 2.059, 2.326, 2.534, 2.704, 2.847, 2.970, 3.078)
# One condition may scatter less than the others: the sd of its n replicates counts where it is smaller by more
# than 1 + this / (n - 1), as that of two is by chance once in eight times.
_OWN = 4.0
# Replicates that are copies all over tell no scatter; it is then taken as this share of the range of all of them.
UNKNOWN_SHARE = 1.0 / 10.0
# A grid finer than ten digits is rounding of the arithmetic; one of units that were converted (rad) is told from
# the arithmetic to five. Fewer distinct readings than this lie on a coarse grid from some offset by chance.
_DIGITS, _COARSE, _FEWEST = 10, 1e-5, 6
# Of one or two numbers alone, a grid would be the numbers themselves.
_FEW = 4


def together(chances: Iterable[float], most: int = _MOST_COUNTED) -> float:
    """That all agree, of the probabilities of each."""
    ordered = sorted(chances)[:most]
    if not ordered:
        return 1.0
    return ordered[0] * math.prod(min(1.0, _TOGETHER * p) for p in ordered[1:])


def agreement(sd: float, step: float) -> float:
    """The probability that two readings of that scatter agree on a grid of that step."""
    return 1.0 if sd <= 0.0 or step <= 0.0 else min(1.0, _AGREE * step / sd)


def sd_of_range(found: Sequence[float]) -> float:
    """From the range of two readings or more."""
    return (max(found) - min(found)) / _RANGES[min(len(found) - 2, len(_RANGES) - 1)]


def lower_median(numbers: list[float]) -> float:
    """The middle one, of an even number the lower of the two."""
    return sorted(numbers)[(len(numbers) - 1) // 2]


class Grid:
    """The coarsest step of which all numbers are multiples, for those of a size and above: one that is rounded to
    four digits lies on a coarser grid where it is large."""

    def __init__(self, values: Iterable[float]) -> None:
        found = sorted({abs(v) for v in values} - {0.0}, reverse=True)
        self._sizes = [-v for v in found]
        largest = found[0] if found else 1.0
        self._unit = 10.0 ** (math.floor(math.log10(largest)) + 1 - _DIGITS)
        whole = [round(v / self._unit) for v in found]
        self._decimal = list(accumulate(whole, math.gcd))
        self._converted = list(accumulate(found, _common_step))
        # Readings less the thickness of a plate, say, are no multiples of their step, but their differences are.
        apart = [a - b for a, b in pairwise(whole)] if len(whole) >= _FEWEST else []
        self._offset = math.gcd(*apart) * self._unit if apart else 0.0

    def step(self, size: float) -> float:
        """Of the numbers of at least that size; 0 where there are none."""
        count = bisect_right(self._sizes, -size * (1.0 - 1e-12))
        if not self._sizes:
            return 0.0
        count = min(max(count, _FEW), len(self._sizes))
        return max(self._decimal[count - 1] * self._unit, self._converted[count - 1], self._offset)


def _common_step(a: float, b: float) -> float:
    """Of two positive numbers, `a` perhaps such a step already; 0 where there is none above _COARSE of `b`."""
    if a <= 0.0:
        return 0.0
    step, rest, least = a, b, _COARSE * b
    while rest > least:
        step, rest = rest, abs(math.remainder(step, rest))
    # Euclid's remainders gather the arithmetic's error; a whole fraction of the larger number has none.
    step = max(a, b) / max(round(max(a, b) / step), 1) if step > 0.0 else 0.0
    fits = all(abs(math.remainder(v, step)) <= 1e-3 * step for v in (a, b)) if step > least else False
    return step if fits else 0.0


class _Known(NamedTuple):
    """Of one observable: its grid, its sd in most conditions, the largest sd of each condition that its own
    replicates leave room for (if two of them differ in anything) and its smallest size there."""

    grid: Grid
    sd: float
    largest_sds: Mapping[str, float]
    smallest: Mapping[str, float]


class Chance:
    """What the replicates of a data set tell of the chance that two of them agree.

    `values`: readings by name of each (condition, replicate).
    """

    def __init__(self, values: Mapping[Place, Mapping[str, float]]) -> None:
        self._known: dict[str, _Known | None] = {}
        by_name: dict[str, dict[str, list[float]]] = {}
        own: dict[str, dict[str, list[float]]] = {}
        several = _several(values)
        for place, read in values.items():
            for name, value in read.items():
                by_name.setdefault(name, {}).setdefault(place[0], []).append(value)
                if place in several:
                    own.setdefault(name, {}).setdefault(place[0], []).append(value)
        for name, found in by_name.items():
            self._known[name] = _known(found, own.get(name, {}))

    def of(self, names: Iterable[str], first: str, second: str) -> float:
        """That a replicate of the condition `first` and one of `second` agree in all of these."""
        return together(max(self._one(name, first), self._one(name, second)) for name in names)

    def least(self, names: Iterable[str]) -> float:
        """Below which no two conditions have it."""
        known = [self._known[name] for name in names]
        return together(1.0 if k is None else agreement(k.sd, k.grid.step(0.0)) for k in known)

    def _one(self, name: str, condition: str) -> float:
        known = self._known[name]
        if known is None:
            return 1.0
        sd = min(known.sd, known.largest_sds.get(condition, known.sd))
        return agreement(sd, known.grid.step(known.smallest[condition]))


def _several(values: Mapping[Place, Mapping[str, float]]) -> set[Place]:
    """A replicate of each kind, in the conditions whose replicates are not all alike: copies tell no scatter."""
    kinds: dict[str, dict[Hashable, Place]] = {}
    for place, read in values.items():
        kind = tuple(sorted((name, f"{value:.9e}") for name, value in read.items()))
        kinds.setdefault(place[0], {}).setdefault(kind, place)
    return {place for found in kinds.values() if len(found) > 1 for place in found.values()}


def _known(found: Mapping[str, list[float]], own: Mapping[str, list[float]]) -> _Known | None:
    """Of the readings by condition, all of them and those that tell the scatter; None where they never vary."""
    everything = [value for values in found.values() for value in values]
    spread = max(everything) - min(everything)
    if spread <= 1e-9 * max(abs(value) for value in everything):
        return None
    sds = {c: sd_of_range(values) for c, values in own.items() if len(values) > 1}
    sd = lower_median(list(sds.values())) if sds else spread * UNKNOWN_SHARE
    largest = {c: of_c * (1.0 + _OWN / (len(own[c]) - 1)) for c, of_c in sds.items()}
    smallest = {c: min(abs(v) for v in values) for c, values in found.items()}
    return _Known(Grid(everything), sd, largest, smallest)

"""Replicates that are copies: the same numbers twice are one experiment, and would understate the noise.

Two replicates are copies when they agree in all that both of them observed, to rounding, and when what they agree
in holds more digits than chance would give: five significant digits within one condition, eight across conditions.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Iterator, Mapping
from itertools import islice

from service.domain.data_set.records import Observation

Place = tuple[str, str]
Names = frozenset[str]
Table = dict[Hashable, list[Place]]
DIGITS_WITHIN, DIGITS_ACROSS = 5, 8
_SAME = 1e-9
# A replicate is compared with those that observed the same and with this many other sets of observables, each by
# this many choices of what is shared: made-up tables may not cost hours or all memory.
MOST_SETS, MOST_TABLES = 64, 16
# Of those that agree to seven digits, so many are looked at closely.
MOST_ALIKE = 20


def significant_digits(value: float) -> int:
    """Digits that a measured number carries: 0.0312 has three, 1200 two, 0 none."""
    if value == 0.0:
        return 0
    mantissa = f"{value:.9e}".lstrip("-").split("e")[0]
    return len(mantissa.replace(".", "").rstrip("0"))


def copied_replicates(observations: Iterable[Observation]) -> Iterator[tuple[Place, str]]:
    """Each replicate that repeats an earlier one, with the sentence that says which.

    Replicates are looked up by all that they share, so the time grows with their number and not with its square.
    """
    values: dict[Place, dict[str, float]] = {}
    for o in observations:
        values.setdefault((o.condition, o.replicate), {})[o.observable] = o.value
    found = _Earlier(values)
    for place, mine in values.items():
        other = found.like(place, mine)
        if other is not None:
            yield place, f"an experiment of its own; it repeats replicate {other[1]} of {other[0]}"
        found.add(place, mine)


class _Earlier:
    """Replicates that were seen, by the set of what they observed, and each set by the values of some of it."""

    def __init__(self, values: Mapping[Place, Mapping[str, float]]) -> None:
        self._values = values
        self._by_names: dict[Names, list[Place]] = {}
        self._tables: dict[Names, dict[Names, Table]] = {}

    def add(self, place: Place, mine: Mapping[str, float]) -> None:
        names = frozenset(mine)
        self._by_names.setdefault(names, []).append(place)
        for shared, table in self._tables.get(names, {}).items():
            self._enter(table, place, shared)

    def like(self, place: Place, mine: Mapping[str, float]) -> Place | None:
        """The first that `mine` is a copy of."""
        names = frozenset(mine)
        sets = [names] if names in self._by_names else []
        sets += [theirs for theirs in islice(self._by_names, MOST_SETS) if theirs != names]
        for theirs in sets:
            shared = names & theirs
            digits = sum(significant_digits(mine[n]) for n in shared)
            if digits < DIGITS_WITHIN:
                continue
            condition = None if digits >= DIGITS_ACROSS else place[0]
            near = self._table(theirs, shared).get(_key(condition, mine, shared), ())
            for other in near:
                if all(math.isclose(mine[n], self._values[other][n], rel_tol=_SAME) for n in shared):
                    return other
        return None

    def _table(self, theirs: Names, shared: Names) -> Table:
        tables = self._tables.setdefault(theirs, {})
        if shared not in tables and (shared == theirs or len(tables) < MOST_TABLES):
            tables[shared] = {}
            for place in self._by_names[theirs]:
                self._enter(tables[shared], place, shared)
        return tables.get(shared, {})

    def _enter(self, table: Table, place: Place, shared: Names) -> None:
        for condition in (None, place[0]):
            near = table.setdefault(_key(condition, self._values[place], shared), [])
            if len(near) < MOST_ALIKE:
                near.append(place)


def _key(condition: str | None, values: Mapping[str, float], shared: Names) -> Hashable:
    """The condition (None: any) and the values to rounding."""
    return condition, tuple(f"{values[name]:.6e}" for name in sorted(shared))

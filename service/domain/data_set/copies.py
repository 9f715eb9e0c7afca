"""Replicates that are copies: the same numbers twice are one experiment, and would understate the noise.

Two replicates are copies when they agree in all that both of them observed, to rounding, and when an honest data
set of so many replicates would hold such a pair less than once in a thousand times (chance.py): readings that are
rounded coarsely meet by chance. So are two surface scans that agree in every height.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import NamedTuple

from service.domain.data_set.chance import (
    FALSE_ALARMS,
    UNKNOWN_SHARE,
    Chance,
    Grid,
    Place,
    agreement,
    lower_median,
    sd_of_range,
    together,
)
from service.domain.data_set.records import Observation, Profile

Names = frozenset[str]
Table = dict[Hashable, list[Place]]
_SAME = 1e-9
# A replicate is compared with those that observed the same and with this many other sets of observables, each by
# this many choices of what is shared: made-up tables may not cost hours or all memory.
MOST_SETS, MOST_TABLES = 64, 16
# Of those that agree to seven digits, so many are looked at closely.
MOST_ALIKE = 20
# Heights of near points vary together: so many of a scan are worth one.
_NEAR_POINTS = 4


class _Pairs:
    """How many pairs of replicates there are, in one condition and across conditions: each is compared."""

    def __init__(self, places: Iterable[Place]) -> None:
        sizes = Counter(condition for condition, _ in places)
        self._within = sum(math.comb(n, 2) for n in sizes.values())
        self._across = math.comb(sizes.total(), 2) - self._within

    def too_few(self, chance: float, is_within: bool) -> bool:
        """Whether a pair that agrees with that probability would hardly be found among them."""
        return chance * (self._within if is_within else self._across) <= FALSE_ALARMS


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
        self._pairs, self._chance = _Pairs(values), Chance(values)
        self._tells: dict[Names, bool] = {}
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
            if not self._can_tell(shared):
                continue
            table = self._table(theirs, shared)
            for condition in (place[0], None):
                for other in table.get(_key(condition, mine, shared), ()):
                    if self._is_copy(place, other, shared):
                        return other
        return None

    def _can_tell(self, shared: Names) -> bool:
        """Whether any agreement in these would be too improbable: where readings are few and coarse, none is."""
        if shared not in self._tells:
            least = self._chance.least(shared)
            self._tells[shared] = any(self._pairs.too_few(least, is_within) for is_within in (True, False))
        return self._tells[shared]

    def _is_copy(self, place: Place, other: Place, shared: Names) -> bool:
        mine, theirs = self._values[place], self._values[other]
        if not all(math.isclose(mine[n], theirs[n], rel_tol=_SAME) for n in shared):
            return False
        chance = self._chance.of(shared, place[0], other[0])
        return self._pairs.too_few(chance, place[0] == other[0])

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


class _Scan(NamedTuple):
    """A surface: its points, (theta deg, r m) after (theta, r), and their heights, m, both as bytes of doubles."""

    points: bytes
    heights: bytes


def copied_scans(profiles: Sequence[Profile]) -> Iterator[tuple[Place, str]]:
    """Each replicate whose scanned surface repeats an earlier one, with the sentence that says which."""
    scans = {(p.condition, p.replicate): _scan(p) for p in profiles}
    pairs = _Pairs(scans)
    of_points: dict[bytes, dict[str, set[bytes]]] = {}
    for place, scan in scans.items():
        of_points.setdefault(scan.points, {}).setdefault(place[0], set()).add(scan.heights)
    earlier: dict[_Scan, Place] = {}
    chances: dict[bytes, float] = {}
    for place, scan in scans.items():
        other = earlier.setdefault(scan, place)
        if other == place:
            continue
        if scan.points not in chances:
            chances[scan.points] = _chance_of_scans(list(of_points[scan.points].values()))
        if pairs.too_few(chances[scan.points], other[0] == place[0]):
            yield place, f"a scan of its own; it repeats replicate {other[1]} of {other[0]}"


def _scan(profile: Profile) -> _Scan:
    """To a micrometre, its points in order."""
    points = zip(profile.theta_deg, profile.r_m, profile.h_m, strict=True)
    ordered = sorted((round(theta, 6), round(r, 6), round(h, 6)) for theta, r, h in points)
    return _Scan(
        array("d", (x for theta, r, _ in ordered for x in (theta, r))).tobytes(),
        array("d", (h for _, _, h in ordered)).tobytes(),
    )


def _chance_of_scans(conditions: Sequence[set[bytes]]) -> float:
    """That two scans of these points agree in all, of the different scans of each condition."""
    scans = [[array("d", heights) for heights in found] for found in conditions]
    heights = [h for found in scans for scan in found for h in scan]
    sds = [
        sd_of_range(at_point) for found in scans if len(found) > 1 for at_point in zip(*found, strict=True)
    ]
    varying = [sd for sd in sds if sd > 0.0]
    if varying:
        sd, count = lower_median(varying), len(varying) // sum(len(found) > 1 for found in scans)
    else:
        sd, count = (max(heights) - min(heights)) * UNKNOWN_SHARE, len(set(scans[0][0]))
    count = max(count // _NEAR_POINTS, 1)
    return together([agreement(sd, Grid(heights).step(0.0))] * count, count)

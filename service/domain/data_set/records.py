"""A measured data set in memory: conditions, observations and surface profiles, all in the units of columns.py."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields

from service.domain.data_set.columns import NOT_OF, NUMBERS_OF_A_CONDITION, OBSERVABLES_OF, REMOVALS, TESTS
from service.domain.data_set.rigs import RIGS
from service.domain.errors import InvalidValue

Psd = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Condition:
    """One way a test was done. None is the rig's or the material's own value. Lengths m, mass kg, see columns.py.

    Raises InvalidValue for a number out of its range or an unknown test or removal.
    """

    condition: str
    test: str
    material: str
    mass_kg: float
    psd: Psd | None = None
    particle_density_kg_m3: float | None = None
    moisture_percent: float = 0.0
    base_diameter_m: float | None = None
    cylinder_diameter_m: float | None = None
    cylinder_height_m: float | None = None
    removal: str = "instant"
    lift_speed_m_s: float = 0.1
    drop_height_m: float = 0.0
    holdout: bool = False
    belt_speed_m_s: float = 1.79
    belt_tilt_deg: float = 4.0
    feed_rate_kg_s: float = 41.7
    deflector_near_pitch_deg: float = 45.0
    deflector_far_pitch_deg: float = 45.0
    deflector_ridge_across_m: float = -0.18
    deflector_ridge_height_m: float = -0.1
    deflector_rotation_deg: float = 0.0

    def __post_init__(self) -> None:
        if self.test not in TESTS:
            raise InvalidValue("condition.test", self.test, " or ".join(TESTS))
        if self.removal not in REMOVALS:
            raise InvalidValue("condition.removal", self.removal, " or ".join(REMOVALS))
        for name, quantity in NUMBERS_OF_A_CONDITION.items():
            value = getattr(self, name)
            if value is not None and not quantity.allows(value):
                raise InvalidValue(f"condition.{name}", value, quantity.allowed)

    @property
    def settings(self) -> tuple[object, ...]:
        """What was done, whatever it was called and whether it is held out: the numbers that its test has."""
        left_out = {"condition", "holdout", *self._not_its_own}
        return tuple((f.name, self.used(f.name)) for f in fields(self) if f.name not in left_out)

    @property
    def ignored(self) -> tuple[str, ...]:
        """What is stated, other than a default, though its test or removal has no such thing."""
        defaults = {f.name: f.default for f in fields(self)}
        return tuple(name for name in self._not_its_own if getattr(self, name) != defaults[name])

    @property
    def _not_its_own(self) -> tuple[str, ...]:
        return NOT_OF[self.test] if self.removal == "lift" else (*NOT_OF[self.test], "lift_speed_m_s")

    def used(self, name: str) -> object:
        """A field as the test was done: the rig's own size where none is stated (None of an unknown material)."""
        stated = getattr(self, name)
        return RIGS.get(self.material, {}).get(name) if stated is None else stated


@dataclass(frozen=True)
class Observation:
    """One number of one replicate, in its observable's unit; `sensor_sd` likewise, None where not stated."""

    condition: str
    replicate: str
    observable: str
    value: float
    sensor_sd: float | None = None


@dataclass(frozen=True)
class Profile:
    """A scanned surface of one replicate: azimuth (deg), radius (m) and height (m) of its points."""

    condition: str
    replicate: str
    theta_deg: tuple[float, ...]
    r_m: tuple[float, ...]
    h_m: tuple[float, ...]


@dataclass(frozen=True)
class DataSet:
    """Checked tables. Raises InvalidValue where an observation or profile has no condition or another test."""

    conditions: tuple[Condition, ...]
    observations: tuple[Observation, ...]
    profiles: tuple[Profile, ...] = ()

    def __post_init__(self) -> None:
        tests = {c.condition: c.test for c in self.conditions}
        if len(tests) != len(self.conditions):
            raise InvalidValue("conditions", sorted(tests), "each name once")
        for o in self.observations:
            if o.observable not in OBSERVABLES_OF.get(tests.get(o.condition, ""), {}):
                raise InvalidValue("observation", o, "an observable of its condition's test")
        for p in self.profiles:
            if p.condition not in tests:
                raise InvalidValue("profile", p.condition, "a condition of the data set")

    def restricted(self, names: Iterable[str]) -> DataSet:
        """The same with these conditions only."""
        kept = set(names)
        return DataSet(
            tuple(c for c in self.conditions if c.condition in kept),
            tuple(o for o in self.observations if o.condition in kept),
            tuple(p for p in self.profiles if p.condition in kept),
        )

    @property
    def training(self) -> DataSet:
        """What a diagnosis may look at."""
        return self.restricted(c.condition for c in self.conditions if not c.holdout)

    @property
    def held_out(self) -> DataSet:
        """What is opened once, after the verdict."""
        return self.restricted(c.condition for c in self.conditions if c.holdout)

    @property
    def replicates(self) -> Mapping[str, tuple[str, ...]]:
        """Names of the replicates of each condition, in order of appearance."""
        found: dict[str, dict[str, None]] = {c.condition: {} for c in self.conditions}
        for o in self.observations:
            found[o.condition][o.replicate] = None
        for p in self.profiles:
            found[p.condition][p.replicate] = None
        return {name: tuple(seen) for name, seen in found.items()}

    @property
    def split_hash(self) -> str:
        """SHA-256 of which conditions are held out and of all that was measured, as hexadecimal digits.

        The order of the rows does not matter; a changed value, or a condition moved to the other block, does.
        """
        rows = [sorted(json.dumps(asdict(r), sort_keys=True) for r in table) for table in self._tables]
        return hashlib.sha256(json.dumps(rows).encode()).hexdigest()

    @property
    def held_out_hash(self) -> str | None:
        """SHA-256 of what was done and read in the held-out conditions; None where nothing was.

        Names do not matter, nor what was trained on: who has seen the numbers has seen them under any name.
        """
        block = self.held_out
        if not block.observations and not block.profiles:
            return None
        read: dict[str, dict[str, list[object]]] = {c.condition: {} for c in block.conditions}
        for o in block.observations:
            read[o.condition].setdefault(o.replicate, []).append((o.observable, o.value))
        for p in block.profiles:
            scan = ("profile", sorted(zip(p.theta_deg, p.r_m, p.h_m, strict=True)))
            read[p.condition].setdefault(p.replicate, []).append(scan)
        rows = sorted(
            json.dumps([c.settings, sorted(_in_order(found) for found in read[c.condition].values())])
            for c in block.conditions
        )
        return hashlib.sha256(json.dumps(rows).encode()).hexdigest()

    @property
    def _tables(self) -> tuple[tuple[Condition | Observation | Profile, ...], ...]:
        return self.conditions, self.observations, self.profiles


def _in_order(readings: Iterable[object]) -> str:
    return json.dumps(sorted(json.dumps(reading) for reading in readings))

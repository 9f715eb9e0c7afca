"""The library of effects, read from effects.toml: what may be wrong with a model, and how it would be checked."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from service.domain.data_set.records import Condition
from service.domain.errors import InvalidValue

# An azimuth between the simulated directions of an effect is a combination of their fingerprints.
AZIMUTHS = 24
FACTOR_E, FACTOR_10, PERCENT, DOUBLING, NUMBER = "factor_e", "factor_10", "percent", "doubling", "number"
TOLD_AS = (FACTOR_E, FACTOR_10, PERCENT, DOUBLING, NUMBER)


@dataclass(frozen=True)
class Check:
    """A reference measurement that settles an effect directly; `cost` in units of one pile test."""

    what: str
    cost: float


@dataclass(frozen=True)
class Told:
    """How an engineer reads an amplitude (effect_words.py): `as_` one of TOLD_AS, put where `words` has its {}.

    Raises InvalidValue for another `as_`, and for words without just one place.
    """

    as_: str
    words: str

    def __post_init__(self) -> None:
        if self.as_ not in TOLD_AS:
            raise InvalidValue("told.as", self.as_, "one of " + ", ".join(TOLD_AS))
        if self.words.count("{}") != 1:
            raise InvalidValue("told.words", self.words, "words with one {}")


@dataclass(frozen=True)
class Clause:
    """One way to be in scope: fields of the condition that must be equal, and those that must be above one."""

    equal: tuple[tuple[str, str], ...] = ()
    above: tuple[tuple[str, float], ...] = ()

    def holds(self, condition: Condition) -> bool:
        """A size that is not stated is the rig's; False where the material, and so its rig, is unknown."""
        same = all(condition.used(name) == value for name, value in self.equal)
        return same and all(_is_above(condition.used(name), value) for name, value in self.above)


def _is_above(used: object, value: float) -> bool:
    return isinstance(used, int | float) and used > value


@dataclass(frozen=True)
class Effect:
    """A candidate cause with one amplitude; see the head of effects.toml for its fields.

    Raises InvalidValue where the range does not hold 0 or the prior's scale is not inside it.
    """

    id: str
    what: str
    law: str
    amplitude: str
    unit: str
    told: Told
    lowest: float
    highest: float
    scale: float
    scope: tuple[Clause, ...]
    effect_class: str
    check: Check
    directions_deg: tuple[float, ...] = ()
    is_reading: bool = False

    def __post_init__(self) -> None:
        if not self.lowest <= 0.0 < self.highest:
            raise InvalidValue(f"{self.id}.range", (self.lowest, self.highest), "a range that holds 0")
        if not 0.0 < self.scale <= self.highest:
            raise InvalidValue(f"{self.id}.scale", self.scale, f"above 0 to {self.highest}")
        if self.check.cost <= 0.0:
            raise InvalidValue(f"{self.id}.check.cost", self.check.cost, "above 0")
        if self.directions_deg and (self.lowest < 0.0 or len(self.directions_deg) != 2):
            raise InvalidValue(
                f"{self.id}.directions_deg", self.directions_deg, "two, of an amplitude above 0"
            )

    @property
    def is_two_sided(self) -> bool:
        return self.lowest < 0.0

    @property
    def keys(self) -> tuple[str, ...]:
        """What a simulator is asked for: the id, or the id with each direction."""
        if not self.directions_deg:
            return (self.id,)
        return tuple(f"{self.id}@{azimuth:g}" for azimuth in self.directions_deg)

    def acts_on(self, condition: Condition) -> bool:
        """Whether the condition is in the declared scope; outside of it a run is the baseline's, to the bit."""
        return any(clause.holds(condition) for clause in self.scope)


@dataclass(frozen=True)
class SelfTest:
    """A change of the simulation's own settings that should change nothing that is observed."""

    id: str
    what: str
    amplitude: float


@dataclass(frozen=True)
class Library:
    """The effects by id in the order of the file."""

    version: int
    effects: tuple[Effect, ...]
    self_tests: tuple[SelfTest, ...] = ()

    def without(self, *ids: str) -> Library:
        """The library that does not know these effects."""
        return Library(self.version, tuple(e for e in self.effects if e.id not in ids), self.self_tests)

    def __contains__(self, effect: object) -> bool:
        return any(e.id == effect for e in self.effects)

    def __getitem__(self, effect: str) -> Effect:
        return next(e for e in self.effects if e.id == effect)

    def self_test(self, name: str) -> SelfTest:
        """One of the changes of the simulation's own settings."""
        return next(test for test in self.self_tests if test.id == name)

    @property
    def name(self) -> str:
        """Of a null calibration's key: it holds for these effects only."""
        return f"{self.version}:" + ",".join(e.id for e in self.effects)


@cache
def library() -> Library:
    """The library that ships."""
    with (Path(__file__).parent / "effects.toml").open("rb") as file:
        table = tomllib.load(file)
    effects = tuple(_effect(name, entry) for name, entry in table["effects"].items())
    tests = tuple(SelfTest(name, t["what"], t["amplitude"]) for name, t in table["self_tests"].items())
    return Library(table["version"], effects, tests)


def _effect(name: str, entry: Mapping[str, Any]) -> Effect:
    return Effect(
        id=name,
        what=entry["what"],
        law=entry["law"],
        amplitude=entry["amplitude"],
        unit=entry["unit"],
        told=Told(entry["told"]["as"], entry["told"]["words"]),
        lowest=entry["range"][0],
        highest=entry["range"][1],
        scale=entry["scale"],
        scope=tuple(_clause(clause) for clause in entry["scope"]),
        effect_class=entry["class"],
        check=Check(**entry["check"]),
        directions_deg=tuple(entry.get("directions_deg", ())),
        is_reading=entry.get("acts") == "reading",
    )


def _clause(given: Mapping[str, Any]) -> Clause:
    bounded = {name: value["above"] for name, value in given.items() if isinstance(value, dict)}
    return Clause(
        equal=tuple((name, value) for name, value in given.items() if name not in bounded),
        above=tuple(bounded.items()),
    )

"""What a diagnosis is asked to do, what it will cost, and what it answers, as plain records.

How it is done is the worker's (worker/diagnosis); here are only the numbers that a user chooses.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Self

from service.domain.data_set.columns import OBSERVABLES_OF, SURFACES
from service.domain.data_set.records import Condition
from service.domain.data_set.suitability import LEAST_REPLICATES
from service.domain.errors import InvalidValue
from service.domain.model_use import ModelUse
from service.domain.outcome import StoredArtifact

CONTACT_MODELS = ("paper", "hertz_mindlin")
# Grains in a pile against what its run takes: smaller piles scatter more, larger ones take longer.
FEWEST_GRAINS, MOST_GRAINS = 100, 20_000
FEWEST_RUNS, MOST_RUNS = 16, 1000
MOST_REPLICATES = 100
FEWEST_PLANTS, MOST_PLANTS = 100, 2000
LARGEST_SEED = 2**31 - 1
# The verdict of a plan: nothing was measured, so nothing can be wrong.
PLAN = "plan"


@dataclass(frozen=True)
class PlanSpec:
    """What is asked of tests before they are made: `replicates` of each, the `observables` that would be read (all
    where none is named), and `candidates`, conditions of which the best single one is sought.

    Raises InvalidValue naming the field.
    """

    replicates: int = 4
    observables: tuple[str, ...] = ()
    candidates: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _require_whole("plan.replicates", self.replicates, LEAST_REPLICATES, MOST_REPLICATES)
        known = [SURFACES, *dict.fromkeys(name for names in OBSERVABLES_OF.values() for name in names)]
        for name in self.observables:
            if name not in known:
                raise InvalidValue("plan.observables", name, "one of " + ", ".join(known))
        for field, names in (("observables", self.observables), ("candidates", self.candidates)):
            if len(set(names)) != len(names):
                raise InvalidValue(f"plan.{field}", list(names), "each name once")


@dataclass(frozen=True)
class DiagnosisSpec:
    """`grains` about which a pile is made of. `first_wave`, `second_wave`: runs of each condition that the
    emulators learn from; `plants`: effect-free pseudo-plants that set the thresholds. With `plan` it is not asked
    what was measured says, but what the tests could show: neither second wave nor plants are made. `model`: the
    version of the model that stands in the baseline's place; its effects are amplitudes by key as the version
    states them, of which each condition takes what is in its scope, in proportion to its own water.

    Raises InvalidValue naming the field.
    """

    data_set: int
    grains: int = 600
    contact_model: str = "paper"
    first_wave: int = 64
    second_wave: int = 48
    plants: int = 128
    seed: int = 1
    plan: PlanSpec | None = None
    model: ModelUse | None = None

    def __post_init__(self) -> None:
        if self.contact_model not in CONTACT_MODELS:
            raise InvalidValue("contact_model", self.contact_model, "one of " + ", ".join(CONTACT_MODELS))
        for name, lowest, highest in (
            ("data_set", 1, LARGEST_SEED),
            ("grains", FEWEST_GRAINS, MOST_GRAINS),
            ("first_wave", FEWEST_RUNS, MOST_RUNS),
            ("second_wave", FEWEST_RUNS, MOST_RUNS),
            ("plants", FEWEST_PLANTS, MOST_PLANTS),
            ("seed", 0, LARGEST_SEED),
        ):
            _require_whole(name, getattr(self, name), lowest, highest)

    def as_record(self) -> dict[str, Any]:
        """Plain JSON types only. Without a plan or a model there is no such field, as before there were any."""
        record = asdict(replace(self, model=None))
        del record["model"]
        if self.plan is None:
            del record["plan"]
        return record if self.model is None else {**record, "model": self.model.as_record()}

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Self:
        """What as_record made. Raises InvalidValue."""
        found = dict(record)
        if found.get("plan") is not None:
            lists = {name: tuple(found["plan"][name]) for name in ("observables", "candidates")}
            found["plan"] = PlanSpec(**{**found["plan"], **lists})
        if found.get("model") is not None:
            found["model"] = ModelUse(**found["model"])
        return cls(**found)

    @property
    def request_hash(self) -> str:
        """SHA-256 of everything that was asked for."""
        return hashlib.sha256(json.dumps(self.as_record(), sort_keys=True).encode()).hexdigest()


def request_of(record: Mapping[str, Any]) -> dict[str, Any]:
    """The body of POST /v1/diagnoses that asks for the same as a stored spec."""
    body = {name: value for name, value in record.items() if name != "model"}
    model = record.get("model")
    return body if model is None else {**body, "model_version": model["name"]}


def _require_whole(name: str, value: object, lowest: int, highest: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not lowest <= value <= highest:
        raise InvalidValue(name, value, f"a whole number from {lowest} to {highest}")


# Beside the waves: runs of each condition for the null calibration, for the screen of all effects, for the finer
# look at the five best, and for the simulation's own errors. A test counts what a diagnosis really asks for.
NULL_RUNS, SCREEN_RUNS, REFINE_RUNS, SELF_RUNS = 96, 160, 168, 120
# Particle-steps per second of one core, and simulated seconds of a pile of so many grains; see docs/core.md.
RATE, STEPS_OF_A_PILE = 4.5e6, 60_000.0


@dataclass(frozen=True)
class DiagnosisCost:
    """Simulations and hours of one core, before those that are stored already."""

    runs: int
    hours: float

    def sentence(self) -> str:
        """For the one who asked."""
        if self.hours < 1.0:
            told = f"{max(round(60.0 * self.hours), 1)} minutes"
        elif self.hours < 48.0:
            told = f"{self.hours:.1f} hours"
        else:
            told = f"{self.hours / 24.0:.1f} days"
        return (
            f"About {self.runs} pile tests, {told} on one core; those that an earlier diagnosis made are "
            "not made again."
        )


def expected_cost(spec: DiagnosisSpec, conditions: Sequence[Condition]) -> DiagnosisCost:
    """What a diagnosis of these conditions, or a plan with them, takes at most.

    A finer pile takes more and shorter steps.
    """
    trained = sum(not c.holdout for c in conditions)
    held = len(conditions) - trained
    if spec.plan is not None:
        # What is to be held out later is planned as any other.
        runs = len(conditions) * (spec.first_wave + SCREEN_RUNS)
    else:
        waves = spec.first_wave + spec.second_wave
        runs = trained * (waves + NULL_RUNS + SCREEN_RUNS + REFINE_RUNS + SELF_RUNS) + held * (
            waves + REFINE_RUNS
        )
    steps = STEPS_OF_A_PILE * math.cbrt(spec.grains / 600.0)
    return DiagnosisCost(runs, runs * steps * spec.grains / RATE / 3600.0)


@dataclass(frozen=True)
class Extension:
    """The model with the named effects: the simulator's version, of each effect value, unit and ci90, and the
    contact parameters that go with them (worker/diagnosis/calibrated.py)."""

    base: str
    effects: Mapping[str, Mapping[str, Any]]
    parameters: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class DiagnosisOutcome:
    """What a diagnosis or a plan says (`results`, the published form and more), the extended model where something
    is named, and the null calibration that it made, by its key."""

    verdict: str
    results: Mapping[str, Any]
    extension: Extension | None = None
    calibration: tuple[str, Mapping[str, Any]] | None = None
    artifacts: tuple[StoredArtifact, ...] = ()

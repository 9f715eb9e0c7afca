"""A data set becomes a diagnosis: verdict, held-out gain, next measurement, extended model.

Every simulated pile is stored by the content of its test before the next one runs. So a diagnosis that was killed,
stopped or cancelled goes on from them, to the same bits, and another one of the same lab finds them made.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from demcore.errors import Cancelled
from demcore.experiments.pile_case import PileTest
from demcore.identity import identity
from demcore.source_hash import hash_sources
from service.db.session import Database
from service.domain.data_set.records import Condition
from service.domain.diagnosis import DiagnosisOutcome, DiagnosisSpec, Extension, expected_cost
from service.domain.errors import InvalidValue
from service.domain.extended_model import ALONG
from service.domain.misfit_words import SELF_TESTS, reading
from service.domain.outcome import StoredArtifact
from service.file_store import artifact_store
from service.settings import Settings
from service.studies.claim_job import DiagnosisClaim
from service.studies.open_held_out import open_held_out
from service.studies.stored_runs import find_runs, store_run
from worker import diagnosis
from worker.diagnosis.analysis import expected_theta
from worker.diagnosis.calibrated import kept_baseline, kept_extension
from worker.diagnosis.card import draw_card
from worker.diagnosis.diagnose import Diagnosis, Options, diagnose
from worker.diagnosis.floor import Floor
from worker.diagnosis.gain import can_be_scored, held_out_gain, named_directions, with_gain
from worker.diagnosis.next_measurement import next_measurements
from worker.diagnosis.null_calibration import NullCalibration
from worker.diagnosis.result import Result
from worker.diagnosis.self_tests import SelfTestOutcome, run_self_tests
from worker.diagnosis.simulator import Simulator
from worker.evaluate import store_file
from worker.pile_floor import pile_floor
from worker.pile_simulator import (
    PileReading,
    PileSimulator,
    Runner,
    reading_as_record,
    reading_of,
    run_pile,
)
from worker.recovery import persist

# Gets the progress; False: stop.
Report = Callable[[Mapping[str, Any]], bool]
OPENED_BEFORE = (
    "The held-out conditions were opened by an earlier diagnosis: they are no judge any more, and the gain is not "
    "measured again."
)

NO_JUDGE = (
    "No held-out condition is of a material that was calibrated and was observed: the gain cannot be measured, so "
    "what is named is not claimed."
)


class StoredRuns:
    """Runs tests that are not stored yet, one after the other, and stores each. Raises Cancelled."""

    def __init__(self, database: Database, report: Report, expected: int) -> None:
        self._database = database
        self._report = report
        self._expected = max(expected, 1)
        self.asked = self.made = 0

    def __call__(self, tests: Sequence[PileTest]) -> list[PileReading]:
        keys = [identity(test) for test in tests]
        with self._database.reading() as session:
            known = {key: reading_of(record) for key, record in find_runs(session, keys).items()}
        for key, test in zip(keys, tests, strict=True):
            self.asked += 1
            if key not in known:
                known[key] = self._run(key, test)
            self._tell()
        return [known[key] for key in keys]

    def _run(self, key: str, test: PileTest) -> PileReading:
        reading = run_pile(test, lambda _progress: self._report(self._progress()))
        record = reading_as_record(reading)

        def write(session: Any) -> bool:
            store_run(session, key, record)
            return True

        persist(self._database, write)
        self.made += 1
        return reading

    def _tell(self) -> None:
        if not self._report(self._progress()):
            raise Cancelled

    def _progress(self) -> dict[str, Any]:
        return {
            "phase": "diagnose",
            "fraction": min(self.asked / self._expected, 0.99),
            "runs": self.asked,
            "simulated": self.made,
        }


class Model(NamedTuple):
    """What a diagnosis asks, and how far it is from a reality that hides nothing."""

    simulator: Simulator
    floor: Floor
    sentences: tuple[str, ...] = ()


def model_of(spec: DiagnosisSpec, runner: Runner, conditions: Sequence[Condition]) -> Model:
    """demcore's piles, of the version of the model that is diagnosed."""
    floor, lacking = pile_floor(spec.contact_model, conditions, spec.grains)
    sentences = (lacking,) if lacking else ()
    simulator = PileSimulator(runner, spec.grains, spec.contact_model, model=spec.model)
    return Model(simulator, floor, sentences)


@cache
def _edition() -> str:
    """Of the diagnosis' own code: a stored null calibration holds for the statistics that made it."""
    return hash_sources(Path(diagnosis.__file__).parent)


def evaluate_diagnosis(
    claim: DiagnosisClaim, report: Report, database: Database, settings: Settings
) -> DiagnosisOutcome:
    """Diagnose the claimed data set. Raises Cancelled after a False of `report`."""
    spec = claim.spec
    runner = StoredRuns(database, report, expected_cost(spec, claim.data.conditions).runs)
    simulator, floor, warnings = model_of(spec, runner, claim.data.conditions)
    options = Options(
        floor=floor,
        first_wave=spec.first_wave,
        second_wave=spec.second_wave,
        plants=spec.plants,
        seed=spec.seed,
        edition=_edition(),
    )
    stored = {
        key: NullCalibration(key, np.array(found["statistics"])) for key, found in claim.calibrations.items()
    }
    found = diagnose(claim.data, simulator, options, stored)
    result, sentences = _gained(claim, database, simulator, found, options)
    self_tests = _self_tests(simulator, found, options)
    sentences = (*warnings, *sentences, *(_failed(test) for test in self_tests if not test.passed))
    if found.analysis is not None and found.measured is not None:
        result = replace(
            result, next_measurement=next_measurements(found.analysis, found.measured, spec.seed)
        )
    result = replace(result, cost={"runs": runner.asked, "simulated": runner.made})
    calibration = None
    if result.calibration is not None and result.calibration.key not in claim.calibrations:
        content = {"statistics": result.calibration.statistics.tolist()}
        calibration = (result.calibration.key, content)
    told = {
        **as_results(result, sentences),
        "baseline": kept_baseline(simulator, found),
        "self_tests": [asdict(test) for test in self_tests],
    }
    card = _card(found, result, settings)
    extension = _extension(result, found, kept_extension(simulator, found))
    return DiagnosisOutcome(result.verdict, told, extension, calibration, card)


def _self_tests(simulator: Simulator, found: Diagnosis, options: Options) -> tuple[SelfTestOutcome, ...]:
    """The simulation's own errors at the re-calibrated parameters."""
    if found.setup is None or found.analysis is None or found.measured is None:
        return ()
    theta = expected_theta(found.analysis)
    model, seed = found.setup.model, options.seed * 1000 + 9 * 10**6
    return run_self_tests(simulator, found.setup.known, model, found.measured, theta, seed)


def _failed(test: SelfTestOutcome) -> str:
    condition, _, summary = test.cell.rpartition(" ")
    changed = SELF_TESTS.get(test.id, test.id)
    return (
        f"The simulation itself is not converged: {changed} ({test.id}) moves the {reading(summary)} of condition "
        f"{condition} by {test.shift:.1f} sd of what was measured. A cause that looks like it may be its own."
    )


def _card(found: Diagnosis, result: Result, settings: Settings) -> tuple[StoredArtifact, ...]:
    """The picture that an engineer reads, in the store."""
    store = artifact_store(settings)
    with store.incoming() as folder:
        picture = folder / "card.png"
        draw_card(found, result, picture)
        return (store_file(picture, "card", "image/png", store),)


def _gained(
    claim: DiagnosisClaim, database: Database, simulator: Simulator, found: Diagnosis, options: Options
) -> tuple[Result, tuple[str, ...]]:
    """The result with its gain on the held-out conditions, which are opened once and only for a named effect that
    they can judge."""
    result, data = found.result, found.usable
    if not result.claims or data is None or not data.held_out.conditions:
        return result, result.sentences
    if not can_be_scored(data, found):
        return result, (*result.sentences, NO_JUDGE)
    may_look: list[bool] = []

    def write(session: Any) -> bool:
        may_look.append(open_held_out(session, claim.lease))
        return may_look[-1]

    persist(database, write)
    if not may_look[-1]:
        return result, (*result.sentences, OPENED_BEFORE)
    try:
        gain = held_out_gain(data, simulator, found, options)
    except InvalidValue as error:
        # The verdict stands without it.
        return result, (*result.sentences, f"The gain on held-out conditions could not be measured: {error}.")
    return with_gain(result, gain), result.sentences


def as_results(result: Result, sentences: Sequence[str]) -> dict[str, Any]:
    """The published form, with what a person asks next: limits, sentences, p."""
    return {
        **result.as_dict(),
        "limits": [asdict(limit) for limit in result.limits],
        "p_value": result.p_value,
        "sentences": list(sentences),
    }


def _extension(result: Result, found: Diagnosis, parameters: Mapping[str, Any] | None) -> Extension | None:
    """What is found on top of the model that was diagnosed. An effect that has a direction keeps it, for who
    simulates with it."""
    if not result.claims or found.analysis is None:
        return None
    directions, known = found.analysis.ranking.directions, found.analysis.ranking.known
    effects: dict[str, dict[str, Any]] = {}
    for claim, row in zip(result.claims, named_directions(found), strict=True):
        size = claim.amplitude
        effects[claim.effect] = {**asdict(size), "inclusion": claim.inclusion, "level": claim.level}
        if known[claim.effect].directions_deg:
            parts = directions.along[row].items()
            effects[claim.effect][ALONG] = {key: size.value * part for key, part in parts}
    # The version's own name stands before the @; its parent says it.
    return Extension(result.model_version.rpartition("@")[2], effects, parameters)

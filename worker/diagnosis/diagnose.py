"""The whole diagnosis of a data set, in the order of the method.

judge the data -> emulate in two waves -> re-calibrate -> fingerprints -> rank -> null runs -> refine -> verdict
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.special import ndtri

from service.domain.data_set.cells import BadCell, BadDataSet
from service.domain.data_set.columns import CONDITIONS
from service.domain.data_set.records import Condition, DataSet
from service.domain.data_set.suitability import suitability
from service.domain.effects import Library, library
from service.domain.errors import InvalidValue
from service.domain.misfit_words import reading
from worker.diagnosis.analysis import Analysis, Setup, analyse, expected_theta
from worker.diagnosis.calibration import calibrate, linearise
from worker.diagnosis.cost import Counted
from worker.diagnosis.fingerprints import MOST_REFINED, Prober, refine, screen
from worker.diagnosis.floor import NO_FLOOR, Floor, Misfits
from worker.diagnosis.limits import Power, power
from worker.diagnosis.measured import Frame, Measured, Tables, measure, replicate_tables, stated_sd
from worker.diagnosis.model import Model, Runs, build_model, materials_of, represented, run_effect_free
from worker.diagnosis.null_calibration import NullCalibration, aligned, calibrate_null, design_key
from worker.diagnosis.ranking import Fitted
from worker.diagnosis.result import (
    AMBIGUOUS,
    NAMED,
    NAMED_WITH_REMAINDER,
    NO_MISFIT,
    REFUSED,
    UNEXPLAINED,
    Amplitude,
    Claim,
    Possible,
    Remainder,
    Result,
    Where,
)
from worker.diagnosis.simulator import FloatArray, Simulator
from worker.diagnosis.summaries import NAMES
from worker.diagnosis.verdict import (
    FLAGGED_AT,
    MOST_AMBIGUOUS,
    NAMED_AT,
    TAU_FACTORS,
    Named,
    ambiguous_set,
    distinct,
    named,
    where,
)
from worker.optimizer.design import sobol

LEAST_COVERAGE = 0.8
_NORMAL_95 = 1.6449
_REMAINDER_QUANTILE = 0.99
_STREAM_WAVE = 900


@dataclass(frozen=True)
class Options:
    """`first_wave`, `second_wave`: runs of each condition; `plants`: null runs; `edition`: of this code, where its
    null calibrations outlive it. The last three are ablations."""

    floor: Floor = NO_FLOOR
    known: Library = field(default_factory=library)
    first_wave: int = 64
    second_wave: int = 48
    plants: int = 128
    seed: int = 1
    edition: str = ""
    pooled: bool = True
    refined: bool = True
    remainder: bool = True


@dataclass(frozen=True)
class Diagnosis:
    """The result with what stands behind it: for the card, the gain and the next measurement. `usable` is the part
    of the data set that may be looked at: conditions that were set aside judge nothing either."""

    result: Result
    usable: DataSet | None = None
    measured: Measured | None = None
    setup: Setup | None = None
    analysis: Analysis | None = None
    power: Power | None = None


@dataclass(frozen=True)
class Baseline:
    """The model after two waves, with the cells it shares with the measurement, and the floor's covariance."""

    model: Model
    measured: Measured
    floor: FloatArray
    theta: FloatArray


def diagnose(
    data: DataSet,
    simulator: Simulator,
    options: Options | None = None,
    stored: Mapping[str, NullCalibration] | None = None,
) -> Diagnosis:
    """Of the training conditions; the held-out ones are not looked at (gain.py opens them).

    `stored`: null calibrations by their keys, from earlier diagnoses of the same design and library; without one
    of this design the null runs are made, and come back with the result.

    Raises BadDataSet for a condition that the simulator cannot represent, InvalidValue where it gives nothing that
    was measured.
    """
    options = Options() if options is None else options
    check_represented(data.conditions, simulator)
    judged = suitability(data)
    if judged.usable is None:
        return Diagnosis(_refused(simulator, judged.sentences))
    training = judged.usable.training
    tables, simulator = replicate_tables(training), Counted(simulator)
    measured = measure(training.conditions, tables, stated_sd(training), options.pooled)
    if not measured.frame.size:
        why = "Refused: nothing measured scatters between replicates; a misfit is only one against scatter."
        return Diagnosis(_refused(simulator, (*judged.sentences, why)))
    baseline = build_baseline(simulator, measured, options)
    if baseline.model.coverage < LEAST_COVERAGE:
        share = f"{100 * baseline.model.coverage:.0f} %"
        why = (
            f"Refused: the emulator's leave-one-out 90 % bands hold only {share} of the runs; it needs more."
        )
        return Diagnosis(_refused(simulator, (*judged.sentences, why)))
    setup, screened, prober = _screen(simulator, baseline, options)
    key = design_key(baseline.measured, setup, _null_runs(simulator, options))
    null = (stored or {}).get(key)
    if null is None:
        seed = options.seed + 10**7
        null = calibrate_null(
            key, setup, simulator, baseline.measured, tables, screened, options.plants, seed
        )
    p_value = null.p_value(screened.statistics)
    final_setup, final = setup, screened
    # Without a misfit the verdict stands, and the most runs of all would be for nothing.
    if options.refined and p_value <= FLAGGED_AT:
        final_setup, final = _refined(setup, screened, prober, baseline)
    strength = power(final.evidence)
    result = _judge(screened, final, null, strength, p_value, options)
    unused = _not_used(training.conditions, tables, measured.frame, final_setup.model.frame)
    sentences = (*judged.sentences, *unused, *result.pop("sentences", ()))
    facts = {
        "model_version": simulator.version,
        "design": key,
        "calibration": null,
        "not_testable": strength.not_testable,
        "indistinguishable": strength.indistinguishable,
        "limits": strength.limits,
        "p_value": p_value,
        "cost": {"runs": simulator.runs},
        "sentences": sentences,
    }
    said = Result(**result, **facts)  # type: ignore[arg-type]
    return Diagnosis(said, judged.usable, baseline.measured, final_setup, final, strength)


def _not_used(
    conditions: tuple[Condition, ...], tables: Tables, measured: Frame, used: Frame
) -> tuple[str, ...]:
    """What was observed and judges nothing all the same: else silence about it would look like agreement."""
    seen = {
        (c.test, int(k))
        for c in conditions
        for k in np.flatnonzero(np.isfinite(tables[c.condition]).any(axis=0))
    }
    known, kept = measured.summaries, used.summaries
    reasons = (
        (
            seen - known,
            "how far it scatters between replicates is not known (too few have it, or all are alike)",
        ),
        (known - kept, "most simulated tests do not give it"),
    )
    return tuple(
        f"Not used: {', '.join(reading(NAMES[test][k]) for test, k in sorted(left))}; {why}."
        for left, why in reasons
        if left
    )


def _null_runs(simulator: Simulator, options: Options) -> tuple[object, ...]:
    """What decides on null runs besides the design: the model, its floor, how many runs, and the code's edition.

    Without these a calibration of an older floor or of a coarser model would judge.
    """
    floor = (options.floor.shared.tolist(), options.floor.own.tolist())
    return simulator.version, options.first_wave, options.second_wave, options.plants, options.edition, floor


def check_represented(conditions: tuple[Condition, ...], simulator: Simulator) -> None:
    """Raises BadDataSet with every condition that the simulator cannot represent."""
    reasons = [(c.condition, simulator.cannot(c)) for c in conditions]
    bad = [
        BadCell(CONDITIONS, None, "condition", name, f"one that the model can represent: {why}")
        for name, why in reasons
        if why
    ]
    if bad:
        raise BadDataSet(bad)


def _refused(simulator: Simulator, sentences: tuple[str, ...]) -> Result:
    return Result(REFUSED, simulator.version, "", None, sentences=sentences)


def first_waves(simulator: Simulator, frame: Frame, options: Options) -> dict[str, Runs]:
    """Runs over the whole box, by material."""
    d = len(simulator.parameters)
    found = {}
    for k, material in enumerate(materials_of(frame.conditions)):
        mine = [c for c in frame.conditions if c.material == material]
        u = sobol(d, options.first_wave, _STREAM_WAVE, options.seed, k)
        found[material] = run_effect_free(simulator, mine, u, options.seed * 1000 + 1)
    return found


def build_baseline(simulator: Simulator, measured: Measured, options: Options) -> Baseline:
    """Two waves: over the box, then about the re-calibrated parameters (rule 3); the first alone where the second
    has no run.

    Raises InvalidValue where the simulator gives none of the summaries that were measured.
    """
    d = len(simulator.parameters)
    runs = first_waves(simulator, measured.frame, options)
    frame = represented(measured.frame, runs)
    if not frame.size:
        raise InvalidValue(
            "observations", "none that the model gives", "at least one that it gives in every run"
        )
    measured = aligned(measured, frame)
    floor = options.floor.covariance(frame)
    model = build_model(frame, runs, d, options.first_wave)
    theta = calibrate(model, measured.y, measured.S + floor)
    if not options.second_wave:
        return Baseline(model, measured, floor, theta)
    posterior = linearise(model, measured.y, measured.S + floor, theta).posterior
    spread = 1.5 * np.sqrt(np.diag(posterior)) + 0.03
    for k, material in enumerate(model.materials):
        mine = [c for c in frame.conditions if c.material == material]
        z = ndtri(np.clip(sobol(d, options.second_wave, _STREAM_WAVE + 1, options.seed, k), 1e-4, 1.0 - 1e-4))
        u = np.clip(theta[model.slice(k)] + z * spread[model.slice(k)], 0.0, 1.0)
        second = run_effect_free(simulator, mine, u, options.seed * 1000 + 501)
        runs[material] = runs[material].joined(second)
    model = build_model(frame, runs, d, options.second_wave)
    theta = calibrate(model, measured.y, measured.S + floor, theta)
    return Baseline(model, measured, floor, theta)


def effect_free_misfits(data: DataSet, simulator: Simulator, options: Options) -> Misfits:
    """Of a data set known to hide no effect, re-calibrated: what the floor is estimated from (floor.py)."""
    measured = measure(data.conditions, replicate_tables(data), stated_sd(data))
    baseline = build_baseline(simulator, measured, options)
    problem = linearise(baseline.model, baseline.measured.y, baseline.measured.S, baseline.theta)
    z = baseline.measured.y - baseline.model.mean(baseline.theta)
    # The refit takes its share out of every misfit: z = (1 - H) e, H = J (J' W^-1 J + V0^-1)^-1 J' W^-1.
    H = problem.J @ problem.posterior @ problem.J.T @ np.linalg.inv(problem.W)
    left = np.eye(len(z)) - H
    return Misfits(baseline.model.frame, z, left @ problem.W @ left.T)


def _screen(simulator: Simulator, baseline: Baseline, options: Options) -> tuple[Setup, Analysis, Prober]:
    prober = Prober(simulator, baseline.model, options.seed * 1000 + 5 * 10**6)
    prints = screen(options.known, prober, baseline.model, baseline.theta)
    setup = Setup(baseline.model, options.known, prints, baseline.floor, options.pooled)
    return setup, analyse(setup, baseline.measured.y, baseline.measured.S, baseline.theta), prober


def _refined(setup: Setup, screened: Analysis, prober: Prober, baseline: Baseline) -> tuple[Setup, Analysis]:
    """The top five again, at their fitted amplitudes and the parameters that go with them (rule 5)."""
    ranking = screened.ranking
    theta = expected_theta(screened)
    fitted: dict[str, float] = {}
    for k in np.argsort(-ranking.inclusion)[:MOST_REFINED]:
        effect = setup.known.effects[k]
        size = min(max(float(ranking.amplitude[k]), 0.5 * effect.scale), effect.highest)
        along = ranking.directions.along[ranking.best[k]]
        fitted |= {key: size if effect.directions_deg else size * part for key, part in along.items()}
    prints = refine(setup.prints, prober.fresh().fresh(), setup.model, theta, fitted)
    final = Setup(setup.model, setup.known, prints, setup.floor, setup.pooled)
    return final, analyse(final, baseline.measured.y, baseline.measured.S, theta)


def _judge(
    screened: Analysis,
    final: Analysis,
    null: NullCalibration,
    strength: Power,
    p_value: float,
    options: Options,
) -> dict[str, Any]:
    """Verdict, claims, what else is possible, where, and the remainder."""
    rankings = tuple(final.evidence.rank(factor) for factor in TAU_FACTORS)
    none, inside, outside = final.ranking.probabilities
    if p_value > FLAGGED_AT or none > max(inside, outside):
        return {"verdict": NO_MISFIT}
    found = named(rankings)
    chosen = ambiguous_set(rankings)
    if found.effects and null.p_values(screened.statistics)[0] <= NAMED_AT:
        clear = distinct(found, strength.cosines, final.ranking.known)
        if clear.effects:
            return _named(final, clear, null, options)
        chosen = tuple(dict.fromkeys((*found.effects, *clear.doubles)))
    possible = tuple(
        Possible(final.ranking.known.effects[k].id, float(final.ranking.inclusion[k])) for k in chosen
    )
    if inside >= outside and len(chosen) <= MOST_AMBIGUOUS:
        return {"verdict": AMBIGUOUS, "also_possible": possible}
    return {"verdict": UNEXPLAINED, "unexplained": where(final.ranking), "also_possible": found.possible}


def _named(final: Analysis, found: Named, null: NullCalibration, options: Options) -> dict[str, Any]:
    """A verdict with claims; `unexplained` where what is named would have a size that is not possible."""
    known, fitted = final.ranking.known, final.evidence.together(found.effects)
    claims = tuple(_claim(final, fitted, place, inclusion) for place, inclusion in enumerate(found.inclusion))
    beyond = [c for c in claims if not _is_possible(c, known)]
    if beyond:
        alike = tuple(Possible(c.effect, c.inclusion) for c in claims) + found.possible
        return {"verdict": UNEXPLAINED, "unexplained": where(final.ranking), "also_possible": alike,
                "sentences": tuple(_beyond(c, known) for c in beyond)}  # fmt: skip
    said: dict[str, Any] = {"verdict": NAMED, "claims": claims, "also_possible": found.possible}
    if not options.remainder:
        return said
    left, blocks = final.evidence.left_over(found.effects)
    larger = float(np.sum(null.statistics[:, 1] >= left))
    p_value = (1.0 + larger) / (1.0 + len(null.statistics))
    places: tuple[Where, ...] = ()
    if left > max(null.quantile(1, _REMAINDER_QUANTILE), 0.0):
        share = np.exp(blocks - np.max(blocks))
        order = np.argsort(-share)[:3]
        places = tuple(Where(final.ranking.blocks[k].label, float(share[k] / np.sum(share))) for k in order)
        said |= {"verdict": NAMED_WITH_REMAINDER}
    return said | {"remainder": Remainder(p_value, places)}


def _claim(final: Analysis, fitted: Fitted, place: int, inclusion: float) -> Claim:
    """Of the effect at `place` of those that were fitted beside each other."""
    directions, row = final.ranking.directions, fitted.rows[place]
    effect = final.ranking.known.effects[int(directions.effect[row])]
    sign = 1.0 if effect.directions_deg else directions.along[row][effect.id]
    size, sd = float(fitted.mode[place]), float(np.sqrt(fitted.covariance[place, place]))
    ends = sorted((sign * max(size - _NORMAL_95 * sd, 0.0), sign * (size + _NORMAL_95 * sd)))
    amplitude = Amplitude(sign * size, effect.unit, (ends[0], ends[1]))
    return Claim(effect.id, effect.effect_class, inclusion, amplitude)


def _is_possible(claim: Claim, known: Library) -> bool:
    """Whether its interval meets the effect's physical range."""
    effect = known[claim.effect]
    return claim.amplitude.ci90[0] <= effect.highest and claim.amplitude.ci90[1] >= effect.lowest


def _beyond(claim: Claim, known: Library) -> str:
    effect, size = known[claim.effect], claim.amplitude
    unit = "" if size.unit == "1" else f" {size.unit}"
    return (
        f"What is left looks like {claim.effect} ({effect.what}) of {size.value:.3g}{unit}, beyond what is "
        f"possible ({effect.lowest:g} to {effect.highest:g}{unit}): not named. A wrong unit looks like it."
    )

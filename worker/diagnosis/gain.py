"""The held-out gain of an extended model: use, not cause (rule 9).

Notation (N training cells, H held-out cells, D parameters, k named effects; primes: of the held-out cells)
    D_      [J, F] slopes over theta and over the amplitudes of the named effects         (N, D + k)
    Q       posterior covariance of (theta, a): (D_' W^-1 D_ + prior^-1)^-1
    mean    m'(theta) + F' a at the posterior means; without effects F' a is missing
    cov     S' + E' + floor' + D_' Q D_'^T, and the form error of the fingerprints when extended
    gain    sum over conditions of ln N(y'; extended) - ln N(y'; baseline), nats

The block opens once: who may call this is the service's business; here is the function. The gain of a model that
is extended although nothing is hidden (`null_95`) comes from draws of the linear model without effect.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from service.domain.data_set.records import DataSet
from service.domain.errors import InvalidValue
from worker.diagnosis.calibration import PRIOR_VARIANCE
from worker.diagnosis.diagnose import Diagnosis, Options
from worker.diagnosis.evidence import FORM_ERROR
from worker.diagnosis.fingerprints import REFINED_SEEDS, Prober, change, probe, scope_of, shrink
from worker.diagnosis.measured import Measured, measure, replicate_tables, stated_sd
from worker.diagnosis.model import Model, Runs, build_model, represented, run_effect_free
from worker.diagnosis.null_calibration import aligned
from worker.diagnosis.result import LEVELS, Gain, Result
from worker.diagnosis.simulator import FloatArray, Simulator

NULL_DRAWS = 200
_NORMAL_90 = 1.6449


class _Prediction(NamedTuple):
    mean: FloatArray
    covariance: FloatArray


class _Held(NamedTuple):
    """The held-out cells: what was measured, the emulators there, noise and floor (H, H)."""

    measured: Measured
    model: Model
    fixed: FloatArray


class Fit(NamedTuple):
    """Of the training cells: theta (D,), amplitudes (k,), their covariance Q, and the slopes F (N, k)."""

    theta: FloatArray
    amplitudes: FloatArray
    Q: FloatArray
    gain_matrix: FloatArray


def can_be_scored(data: DataSet, found: Diagnosis) -> bool:
    """Whether a held-out condition has a material that was calibrated, and observations: asked before the block is
    opened, which is once, so it looks at no value."""
    if found.setup is None:
        return False
    observed = {o.condition for o in data.observations} | {p.condition for p in data.profiles}
    held = data.held_out.conditions
    return any(c.material in found.setup.model.materials and c.condition in observed for c in held)


def held_out_gain(data: DataSet, simulator: Simulator, found: Diagnosis, options: Options) -> Gain:
    """Of the effects that `found` names, on the held-out conditions of `data`.

    Raises InvalidValue where nothing is named, no held-out condition has a material that was calibrated, or
    nothing that was measured there is simulated.
    """
    if not found.result.claims or found.setup is None or found.analysis is None:
        raise InvalidValue("gain", found.result.verdict, "asked of a diagnosis that names an effect")
    held = _held_out(data, simulator, found, options)
    rows = named_directions(found)
    base, extended = fit_linear(found, ()), fit_linear(found, rows)
    F = _fingerprints(simulator, found, held, extended, rows)
    before = _predict(held, base, np.zeros((len(F), 0)))
    after = _predict(held, extended, F)
    scores = _scores(held, held.measured.y, before, after)
    return _summary(held, before, after, scores, _null_95(found, held, base, extended, F, rows))


def with_gain(result: Result, gain: Gain) -> Result:
    """The result with its gain; what is named becomes a claim where the gain is above the null's 95 %."""
    level = LEVELS[1] if gain.log_score > max(gain.null_95, 0.0) else LEVELS[0]
    claims = tuple(replace(c, level=level) for c in result.claims)
    return replace(result, claims=claims, gain=gain)


def confirmed(result: Result, later: Result) -> Result:
    """The result with its claims strong where a later diagnosis, of the proposed experiment, names the same class
    with an amplitude whose 90 % interval meets the first."""
    strong = {
        c.effect
        for c in result.claims
        for other in later.claims
        if c.level == LEVELS[1]
        and other.effect_class == c.effect_class
        and c.amplitude.ci90[0] <= other.amplitude.ci90[1]
        and other.amplitude.ci90[0] <= c.amplitude.ci90[1]
    }
    claims = tuple(replace(c, level=LEVELS[2]) if c.effect in strong else c for c in result.claims)
    return replace(result, claims=claims)


def named_directions(found: Diagnosis) -> tuple[int, ...]:
    """Rows of the directions (ranking.py) of the effects that are named."""
    if found.analysis is None:
        return ()
    known = [effect.id for effect in found.analysis.evidence.known.effects]
    return found.analysis.evidence.together([known.index(c.effect) for c in found.result.claims]).rows


def _held_out(data: DataSet, simulator: Simulator, found: Diagnosis, options: Options) -> _Held:
    """Noise of the held-out means is pooled over all conditions: it was not looked at before the verdict."""
    setup = found.setup
    assert setup is not None
    measured = measure(data.conditions, replicate_tables(data), stated_sd(data), options.pooled)
    materials = setup.model.materials
    held = [c for c in data.conditions if c.holdout and c.material in materials]
    keep = np.array([measured.frame.conditions[c] in held for c in measured.frame.condition], dtype=bool)
    if not keep.any():
        raise InvalidValue("holdout", [c.condition for c in held], "conditions of a calibrated material")
    frame = measured.frame.subset(keep)
    runs = {}
    for material, emulator in zip(materials, setup.model.emulators, strict=True):
        mine = [c for c in held if c.material == material]
        found_runs = run_effect_free(simulator, mine, emulator.u, options.seed * 1000 + 8 * 10**6)
        runs[material] = Runs(emulator.u, found_runs.tables)
    frame = represented(frame, runs)
    model = build_model(frame, runs, setup.model.dimension, max(setup.model.last_waves), materials)
    measured = aligned(measured, frame)
    return _Held(measured, model, measured.S + options.floor.covariance(frame))


def fit_linear(found: Diagnosis, rows: tuple[int, ...]) -> Fit:
    """Posterior of theta and of the amplitudes of directions `rows`, linear about the problem's theta."""
    analysis = found.analysis
    assert analysis is not None
    problem, directions = analysis.problem, analysis.ranking.directions
    F = directions.f[list(rows)].T if rows else np.zeros((len(problem.r), 0))
    fitted = analysis.evidence.fitted(rows).mode
    W = problem.W + np.diag(np.sum((FORM_ERROR * F * fitted) ** 2, axis=1))
    tau = directions.tau[list(rows)] if rows else np.zeros(0)
    design = np.hstack([problem.J, F])
    precision = np.concatenate([np.full(problem.J.shape[1], 1.0 / PRIOR_VARIANCE), tau**-2.0])
    weighted = np.linalg.solve(W, design)
    Q = np.linalg.inv(design.T @ weighted + np.diag(precision))
    gain_matrix = Q @ weighted.T
    solution = gain_matrix @ problem.r
    split = problem.J.shape[1]
    theta = np.clip(0.5 + solution[:split], 0.0, 1.0)
    return Fit(theta, np.maximum(solution[split:], 0.0), Q, gain_matrix)


def _fingerprints(
    simulator: Simulator, found: Diagnosis, held: _Held, fit: Fit, rows: tuple[int, ...]
) -> FloatArray:
    """Of the directions `rows` in the held-out cells (H, k), with the seeds of a refined one."""
    analysis = found.analysis
    assert analysis is not None
    directions, frame = analysis.ranking.directions, held.model.frame
    prober = Prober(simulator, held.model, 9 * 10**6)
    baseline = prober.fresh().means(fit.theta, {}, REFINED_SEEDS, np.ones(frame.size, dtype=bool))
    columns = []
    for row, amplitude in zip(rows, fit.amplitudes, strict=True):
        effect = analysis.ranking.known.effects[int(directions.effect[row])]
        size = max(float(amplitude), 0.1 * effect.scale)
        active = scope_of(effect, frame)
        tried = probe(prober, fit.theta, directions.along[row], size, REFINED_SEEDS, active, baseline)
        variance = 2.0 / REFINED_SEEDS / tried.amplitude**2 * np.diag(held.model.run_covariance)
        columns.append(shrink(change(active, tried.means, baseline, tried.amplitude), variance))
    return np.array(columns).T


def _predict(held: _Held, fit: Fit, F: FloatArray) -> _Prediction:
    m, J = held.model.tangent(fit.theta)
    design = np.hstack([J, F])
    covariance = held.fixed + held.model.error(fit.theta) + design @ fit.Q @ design.T
    if F.shape[1]:
        covariance += np.diag(np.sum((FORM_ERROR * F * fit.amplitudes) ** 2, axis=1))
        m = m + F @ fit.amplitudes
    return _Prediction(m, covariance)


def _scores(held: _Held, y: FloatArray, before: _Prediction, after: _Prediction) -> dict[str, float]:
    """Gain in log score by held-out condition, nats."""
    condition = np.array(held.model.frame.condition)
    return {
        held.model.frame.conditions[c].condition: _log_density(y, after, condition == c)
        - _log_density(y, before, condition == c)
        for c in np.unique(condition)
    }


def _log_density(y: FloatArray, prediction: _Prediction, cells: FloatArray) -> float:
    L = np.linalg.cholesky(prediction.covariance[np.ix_(cells, cells)])
    white = np.linalg.solve(L, (y - prediction.mean)[cells])
    return -0.5 * float(white @ white) - float(np.sum(np.log(np.diag(L))))


def _null_95(
    found: Diagnosis, held: _Held, base: Fit, extended: Fit, F: FloatArray, rows: tuple[int, ...]
) -> float:
    """The 95 % quantile of the gain when nothing is hidden: training and held-out cells drawn from the linear
    model without effect, both models fitted to them."""
    analysis = found.analysis
    assert analysis is not None
    stream = np.random.default_rng(np.random.SeedSequence([9, len(rows), held.model.frame.size]))
    problem = analysis.problem
    m, J = held.model.tangent(base.theta)
    split = problem.J.shape[1]
    train_root = np.linalg.cholesky(problem.W)
    held_root = np.linalg.cholesky(held.fixed + held.model.error(base.theta))
    theta_root = np.linalg.cholesky(base.Q)
    gains = []
    for _ in range(NULL_DRAWS):
        shift = theta_root @ stream.standard_normal(split)
        r = problem.J @ (base.theta - 0.5 + shift) + train_root @ stream.standard_normal(len(problem.r))
        y = m + J @ shift + held_root @ stream.standard_normal(len(m))
        plain, rich = base.gain_matrix @ r, extended.gain_matrix @ r
        before = _Prediction(m + J @ (plain + 0.5 - base.theta), _predict(held, base, F[:, :0]).covariance)
        amplitudes = np.maximum(rich[split:], 0.0)
        mean = m + J @ (rich[:split] + 0.5 - base.theta) + F @ amplitudes
        covariance = _predict(held, extended._replace(amplitudes=amplitudes), F).covariance
        gains.append(sum(_scores(held, y, before, _Prediction(mean, covariance)).values()))
    return float(np.quantile(gains, 0.95))


def _summary(
    held: _Held, before: _Prediction, after: _Prediction, scores: dict[str, float], null_95: float
) -> Gain:
    y, sd = held.measured.y, np.sqrt(np.diag(held.measured.S))
    squares = [float(np.mean(((y - p.mean) / sd) ** 2)) for p in (before, after)]
    inside = np.abs(y - after.mean) <= _NORMAL_90 * np.sqrt(np.diag(after.covariance))
    # With the right model the mean square is 1: replicates allow no less.
    room = squares[0] - 1.0
    return Gain(
        log_score=float(sum(scores.values())),
        by_condition=scores,
        conditions_better=sum(score > 0.0 for score in scores.values()),
        rmse_before=float(np.sqrt(squares[0])),
        rmse_after=float(np.sqrt(squares[1])),
        coverage_90=float(np.mean(inside)),
        share_of_ceiling=float(np.clip((squares[0] - squares[1]) / room, -1.0, 1.0)) if room > 0.0 else 0.0,
        null_95=null_95,
    )

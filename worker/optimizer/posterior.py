"""What a study has identified: the emulators' posterior over the whole box (calibration.md decision 8).

Notation (k Sobol points of the box, d variables, responses r)
    u       points in the unit cube                                                        (k, d)
    m, s    mean and inflated sd of a response                                             (k,)
    t       its target; tau its sd: tau^2 = measurement^2 + discrepancy^2
    chi     |t - m| / sqrt(s^2 + tau^2), the distance from the target in sigma             (k,)
    w       P(ok) prod_r exp(-chi_r^2 / 2) / sqrt(s_r^2 + tau_r^2), summing to 1           (k,)

Measurement is the lab's sd. Discrepancy is what a model of spheres may be off and still do: a quarter of the
window, which is read as t +- 2 sd. The prior is uniform over the box, so the weights are the posterior.
A parameter is identified when its posterior sd is small against the prior's, (upper - lower) / sqrt(12).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.domain.search_space import SearchSpace
from service.domain.study import StudySpec
from worker.optimizer.acquisition import counting_sd
from worker.optimizer.crashes import CrashClassifier
from worker.optimizer.design import FloatArray, sobol
from worker.optimizer.emulator import Emulator, emulators
from worker.optimizer.history import History
from worker.optimizer.outlook import build_outlook

POINTS = 60_000
IDENTIFIED_BELOW = 0.35
WEAK_BELOW = 0.8
# A variable takes part in a combination when its coefficient is above this share of the largest.
TAKES_PART = 0.3
_STREAM = 100
_BLOCK = 1024


class Beliefs(NamedTuple):
    """What a study's history says of the box: emulators by observable, and the chance of a run to end well."""

    spec: StudySpec
    emulators: Mapping[str, Emulator]
    crashes: CrashClassifier


class Sample(NamedTuple):
    """Points of the box u (k, d), posterior weights w (k,), P(ok) (k,), chi (k,) of the worst response, and mean
    and inflated sd (k,) of every response by observable."""

    u: FloatArray
    w: FloatArray
    ok: FloatArray
    chi: FloatArray
    means: Mapping[str, FloatArray]
    sds: Mapping[str, FloatArray]


@dataclass(frozen=True)
class Parameter:
    """Posterior of one parameter, physical units; `label` is identified, weak or not identified."""

    name: str
    mean: float
    sd: float
    lower_90: float
    upper_90: float
    sd_ratio: float
    label: str


@dataclass(frozen=True)
class Combination:
    """A direction of the box: coefficients by parameter, in widths of their ranges, and how well it is known."""

    coefficients: Mapping[str, float]
    sd_ratio: float
    label: str

    @property
    def text(self) -> str:
        """As `0.71 a + 0.71 b`, of the parameters that take part."""
        terms = " ".join(
            f"{'-' if c < 0 else '+'} {abs(c):.2f} {name}" for name, c in self.taking_part.items()
        )
        return terms.removeprefix("+ ")

    @property
    def taking_part(self) -> dict[str, float]:
        """Coefficients that are not small."""
        largest = max(abs(c) for c in self.coefficients.values())
        return {name: c for name, c in self.coefficients.items() if abs(c) > TAKES_PART * largest}


@dataclass(frozen=True)
class Posterior:
    """`correlations` in the order of `parameters`; `share_within_2_sigma` of the box, weighted with P(ok).

    `combinations` are the directions of the box, the best known first. `effective_points` says how many equally
    weighted points the sample is worth: under some hundred, the intervals are coarse.
    """

    parameters: tuple[Parameter, ...]
    correlations: tuple[tuple[float, ...], ...]
    combinations: tuple[Combination, ...]
    share_within_2_sigma: float
    effective_points: float


def beliefs(spec: StudySpec, history: History) -> Beliefs | None:
    """The optimizer's own surrogates and classifier, and emulators of what else was measured; None before they say
    enough of every response."""
    if not history.succeeded:
        return None
    outlook = build_outlook(spec, history)
    pairs = zip(spec.responses, outlook.surrogates, strict=True)
    asked = {r.observable: Emulator(r.observable, surrogate) for r, surrogate in pairs}
    if not all(emulator.says_enough for emulator in asked.values()):
        return None
    return Beliefs(spec, {**asked, **emulators(spec.space, history, asked)}, outlook.crashes)


def posterior(spec: StudySpec, history: History, points: int = POINTS) -> Posterior | None:
    """The posterior given the finished designs; None before there is enough to fit."""
    known = beliefs(spec, history)
    return None if known is None else describe(spec.space, draw(known, points))


def draw(known: Beliefs, points: int = POINTS) -> Sample:
    """Weighted points of the box."""
    spec = known.spec
    u = sobol(spec.space.dimension, points, _STREAM, spec.seed)
    ok = np.concatenate([known.crashes.ok_probability(u[k : k + _BLOCK]) for k in range(0, len(u), _BLOCK)])
    predicted = {r.observable: known.emulators[r.observable].predict(u) for r in spec.responses}
    log_w, worst = np.log(np.maximum(ok, 1e-300)), np.zeros(len(u))
    for response in spec.responses:
        mean, sd = predicted[response.observable]
        sigma = np.hypot(sd, counting_sd(response))
        chi = np.abs(response.target - mean) / sigma
        log_w -= np.log(sigma) + 0.5 * chi**2
        worst = np.maximum(worst, chi)
    # In logarithms, and relative to the best point: far from the target every weight would be zero.
    w = np.exp(log_w - np.max(log_w))
    means = {name: mean for name, (mean, _) in predicted.items()}
    return Sample(u, w / np.sum(w), ok, worst, means, {name: sd for name, (_, sd) in predicted.items()})


def resample(sample: Sample, count: int) -> NDArray[np.intp]:
    """Rows (count,) of equal weight by systematic resampling (Douc and Cappe 2005, section 2.4) without a random
    start: row i comes floor or ceil of count w_i times, and the same sample gives the same rows."""
    places = (np.arange(count) + 0.5) / count
    return np.minimum(np.searchsorted(np.cumsum(sample.w), places), len(sample.w) - 1)


def describe(space: SearchSpace, sample: Sample) -> Posterior:
    """Moments, intervals and directions of a sample."""
    u, w = sample.u, sample.w
    mean = w @ u
    centred = u - mean
    covariance = (w[:, None] * centred).T @ centred
    sd = np.sqrt(np.maximum(np.diag(covariance), 1e-30))
    rows = zip(range(u.shape[1]), mean.tolist(), sd.tolist(), strict=True)
    return Posterior(
        parameters=tuple(_parameter(space, j, u[:, j], w, m, s) for j, m, s in rows),
        correlations=tuple(tuple(float(c) for c in row) for row in covariance / np.outer(sd, sd)),
        combinations=_combinations(space, covariance),
        share_within_2_sigma=float(np.mean(sample.ok * (sample.chi <= 2.0))),
        effective_points=float(1.0 / np.sum(w * w)),
    )


def _parameter(space: SearchSpace, j: int, u: FloatArray, w: FloatArray, mean: float, sd: float) -> Parameter:
    variable = space.variables[j]
    width = variable.upper - variable.lower
    lower, upper = interval(u, w, 0.9)
    ratio = sd * math.sqrt(12.0)
    return Parameter(
        name=variable.name,
        mean=variable.lower + width * mean,
        sd=width * sd,
        lower_90=variable.lower + width * lower,
        upper_90=variable.lower + width * upper,
        sd_ratio=ratio,
        label=label(ratio),
    )


def _combinations(space: SearchSpace, covariance: FloatArray) -> tuple[Combination, ...]:
    """Eigenvectors of the covariance in the unit cube; the prior's sd is 1/sqrt(12) in every direction."""
    values, vectors = np.linalg.eigh(covariance)
    found = []
    for value, vector in zip(np.maximum(values, 0.0), vectors.T, strict=True):
        # The sign of an eigenvector is arbitrary: the largest coefficient is made positive.
        upright = vector * np.sign(vector[np.argmax(np.abs(vector))])
        ratio = math.sqrt(12.0 * float(value))
        coefficients = dict(zip(space.names, upright.tolist(), strict=True))
        found.append(Combination(coefficients, ratio, label(ratio)))
    return tuple(found)


def interval(values: FloatArray, w: FloatArray, probability: float) -> tuple[float, float]:
    """The central interval of a weighted sample."""
    order = np.argsort(values)
    cumulative = np.cumsum(w[order])
    tail = 0.5 * (1.0 - probability)
    ends = np.searchsorted(cumulative, [tail, 1.0 - tail])
    lower, upper = values[order][np.minimum(ends, len(values) - 1)]
    return float(lower), float(upper)


def label(sd_ratio: float) -> str:
    """identified under .35 of the prior sd, weak to .8, else not identified."""
    if sd_ratio < IDENTIFIED_BELOW:
        return "identified"
    return "weak" if sd_ratio <= WEAK_BELOW else "not identified"

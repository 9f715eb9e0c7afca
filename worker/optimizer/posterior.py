"""What a study has identified: the emulator's posterior over the whole box (calibration.md decision 8).

Notation (k Sobol points of the box, d variables)
    u       points in the unit cube                                               (k, d)
    m, s    mean and inflated sd of the angle                                     (k,)
    t, tau  target and its sd: the window is read as t +- 2 tau
    chi     |t - m| / sqrt(s^2 + tau^2), the distance from the target in sigma    (k,)
    w       weights, P(ok) exp(-chi^2 / 2) / sqrt(s^2 + tau^2), summing to 1      (k,)

The prior is uniform over the box, so the weights are the posterior. A parameter is identified when its
posterior sd is small against the prior's, (upper - lower) / sqrt(12).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from service.domain.study import StudySpec
from worker.optimizer.design import FloatArray, sobol
from worker.optimizer.history import History
from worker.optimizer.outlook import Outlook, build_outlook

POINTS = 60_000
IDENTIFIED_BELOW = 0.35
WEAK_BELOW = 0.8
_STREAM = 100


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
class Posterior:
    """`correlations` in the order of `parameters`; `share_within_2_sigma` of the box, weighted with P(ok).

    `effective_points` says how many equally weighted points the sample is worth: under some hundred, the
    intervals are coarse.
    """

    parameters: tuple[Parameter, ...]
    correlations: tuple[tuple[float, ...], ...]
    share_within_2_sigma: float
    effective_points: float


def target_sd_deg(spec: StudySpec) -> float:
    """A quarter of the window's width."""
    lower, upper = spec.primary.window
    return 0.25 * (upper - lower)


def posterior(spec: StudySpec, history: History, points: int = POINTS) -> Posterior | None:
    """The posterior given the finished designs; None before any angle."""
    return outlook_posterior(build_outlook(spec, history), points) if history.succeeded else None


def outlook_posterior(outlook: Outlook, points: int = POINTS) -> Posterior:
    """`posterior` for an outlook that is already fitted."""
    spec = outlook.spec
    u = sobol(spec.space.dimension, points, _STREAM, spec.seed)
    w, share = weights(outlook, u)
    mean = w @ u
    centred = u - mean
    covariance = (w[:, None] * centred).T @ centred
    sd = np.sqrt(np.diag(covariance))
    return Posterior(
        parameters=tuple(
            _parameter(spec, j, u[:, j], w, float(mean[j]), float(sd[j])) for j in range(u.shape[1])
        ),
        correlations=tuple(tuple(float(c) for c in row) for row in covariance / np.outer(sd, sd)),
        share_within_2_sigma=share,
        effective_points=float(1.0 / np.sum(w * w)),
    )


def weights(outlook: Outlook, u: FloatArray) -> tuple[FloatArray, float]:
    """Posterior weights of the points u, and the share of the space within two sigma of the target."""
    mean, sd = outlook.surrogate.predict(u)
    ok = outlook.crashes.ok_probability(u)
    sigma = np.sqrt((outlook.inflation * sd) ** 2 + target_sd_deg(outlook.spec) ** 2)
    chi = np.abs(outlook.spec.primary.target - mean) / sigma
    # In logarithms, and relative to the best point: far from the target every weight would be zero.
    log_w = np.log(np.maximum(ok, 1e-300)) - np.log(sigma) - 0.5 * chi**2
    w = np.exp(log_w - np.max(log_w))
    return w / np.sum(w), float(np.mean(ok * (chi <= 2.0)))


def _parameter(spec: StudySpec, j: int, u: FloatArray, w: FloatArray, mean: float, sd: float) -> Parameter:
    variable = spec.space.variables[j]
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

"""P(ok): the chance that a design runs to a measurable pile (calibration.md decision 3).

Notation (N runs, d variables)
    v      designs, unit cube minus 1/2                                       (N, d)
    y      +1 ran, -1 ended in error                                          (N,)
    g      latent score, Gaussian process with mean MU and kernel k           (N,)
    k      S^2 exp(-|v-v'|^2 / (2 L^2)) + W^2 v.v'
    P(ok)  logistic(g), averaged over g's posterior

Laplace's approximation with Newton steps (Rasmussen and Williams 2006, algorithms 3.1 and 3.2). Everything in
the prior is fixed: failures are too few to fit anything to, and a fixed prior answers with none as well as
with many. The linear part lets a failure in one corner speak for the whole side, as crashes usually begin at
one end of a parameter.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.spatial.distance import cdist
from scipy.special import expit, log_expit

from worker.optimizer.design import FloatArray

MU = 4.0
SPREAD = 4.0
SLOPE = 6.0
LENGTH = 0.5
_NEWTON_STEPS = 50


def _kernel(v: FloatArray, w: FloatArray) -> FloatArray:
    # Distances grow with the square root of the dimension; so does the length, to keep neighbours neighbours.
    length = LENGTH * math.sqrt(v.shape[1] / 2.0)
    near: FloatArray = np.exp(-0.5 * cdist(v, w, "sqeuclidean") / length**2)
    return SPREAD**2 * near + SLOPE**2 * (v @ w.T)


def _factor(kernel: FloatArray, root: FloatArray) -> tuple[FloatArray, bool]:
    factor: tuple[FloatArray, bool] = cho_factor(np.eye(len(root)) + root[:, None] * kernel * root)
    return factor


def _mode(kernel: FloatArray, ran: FloatArray) -> FloatArray:
    """Weights a of the posterior mode g - MU = K a.

    Full Newton steps overshoot from the prior mean, where the likelihood of a failure is nearly flat, and
    may cycle for ever; each is therefore halved until the log posterior grows.
    """
    weights = np.zeros(len(ran))

    def log_posterior(a: FloatArray) -> float:
        latent = kernel @ a
        return float(np.sum(log_expit((2.0 * ran - 1.0) * (MU + latent))) - 0.5 * a @ latent)

    value = log_posterior(weights)
    for _ in range(_NEWTON_STEPS):
        latent = kernel @ weights
        p = expit(MU + latent)
        root = np.sqrt(p * (1.0 - p))
        b = root**2 * latent + ran - p
        step = b - root * cho_solve(_factor(kernel, root), root * (kernel @ b)) - weights
        size = 1.0
        while (new := log_posterior(weights + size * step)) < value and size > 1e-6:
            size *= 0.5
        if new - value < 1e-10:
            break
        weights, value = weights + size * step, new
    return weights


class CrashClassifier:
    """Fitted to the designs that ran and those that failed."""

    def __init__(self, u: FloatArray, ran: FloatArray) -> None:
        """u (N, d) in the unit cube; ran (N,) is 1 or 0; N is at least 1."""
        self._v = u - 0.5
        kernel = _kernel(self._v, self._v)
        weights = _mode(kernel, ran)
        p = expit(MU + kernel @ weights)
        self._root = np.sqrt(p * (1.0 - p))
        self._factor = _factor(kernel, self._root)
        self._weights = ran - p

    def ok_probability(self, u: FloatArray) -> FloatArray:
        """P(ok) at u (k, d): `logistic(mean / sqrt(1 + pi var / 8))` (MacKay 1992)."""
        v = u - 0.5
        cross = _kernel(v, self._v)
        mean = MU + cross @ self._weights
        prior = SPREAD**2 + SLOPE**2 * np.sum(v * v, axis=1)
        scaled = self._root[:, None] * cross.T
        upper, _ = self._factor
        half = solve_triangular(upper, scaled, trans="T", check_finite=False)
        variance = np.maximum(prior - np.sum(half * half, axis=0), 0.0)
        return np.asarray(expit(mean / np.sqrt(1.0 + math.pi * variance / 8.0)), dtype=np.float64)

"""The Gaussian process on one response; the only file that imports scikit-learn.

Notation (G groups of replicates, d variables; "unit" is the response's)
    u       designs in the unit cube                                     (G, d)
    y       mean response of each group, unit                            (G,)
    n       runs behind each mean                                        (G,)
    sigma   noise sd of one run, unit; alpha = sigma^2 / n               (G,)
    c       offset: mean of y, less the link
    a, l    amplitude (unit) and length scales of the Matern 5/2 part    scalar, (d,)
    w       sd of the slopes of the linear trend, unit per box width
    K       kernel matrix with alpha on its diagonal                     (G, G)
    m, s    posterior mean and sd of the noiseless response, unit

Model: `y - c - link(u) ~ N(0, a^2 Matern(u, u'; l) + w^2 (1/4 + v.v') + alpha)` with v = u - 1/2. The trend is a
Bayesian linear regression inside the kernel: intercept sd w/2 about the data's mean, slope sd w. `link` is
rho times another test's emulator (link.py), or nothing.

Hyper-parameters, the noise among them, maximise likelihood times priors. The priors are in degrees because the
response is an angle, or in a fifth of the response's spread where it is not: they keep the fit stable with five
points, where the likelihood alone would choose noise-free interpolation or a constant.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, cho_solve, cholesky
from scipy.optimize import minimize
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, DotProduct, Matern

from worker.optimizer.design import FloatArray
from worker.optimizer.noise import NoiseEvidence

AMPLITUDE_BOUNDS = (0.3, 20.0)
LENGTH_BOUNDS = (0.1, 10.0)
NOISE_BOUNDS = (0.02, 10.0)
# Median and sd (of the logarithm).
LENGTH_PRIOR = (1.0, 0.5)

Link = Callable[[FloatArray], FloatArray]


class Prior(NamedTuple):
    """Median and log-sd of the amplitude, and the sd of the slopes, in degrees or fifths of the spread."""

    amplitude: tuple[float, float]
    slope: float


RESPONSE = Prior((5.0, 0.5), 8.0)
# Of what is left of a response after another test's emulator has been taken off.
DIFFERENCE = Prior((1.0, 0.5), 2.0)


class TrainingSet(NamedTuple):
    """Group means with the number of runs behind each."""

    u: FloatArray
    y: FloatArray
    n: FloatArray


class Hyperparameters(NamedTuple):
    """All that, beside the training set and the link, determines the surrogate; in the response's unit."""

    amplitude: float
    length_scales: tuple[float, ...]
    noise_sd: float
    offset: float
    slope: float

    def as_dict(self) -> dict[str, Any]:
        return {**self._asdict(), "length_scales": list(self.length_scales)}

    @classmethod
    def from_dict(cls, stored: dict[str, Any]) -> Hyperparameters:
        plain = {name: float(stored[name]) for name in cls._fields if name != "length_scales"}
        return cls(length_scales=tuple(float(v) for v in stored["length_scales"]), **plain)


def training_set(rows: Iterable[tuple[tuple[float, ...], float]]) -> TrainingSet:
    """Group single runs (u, response) by u."""
    by_u: dict[tuple[float, ...], list[float]] = {}
    for u, value in rows:
        by_u.setdefault(u, []).append(value)
    return TrainingSet(
        np.array(list(by_u), dtype=np.float64),
        np.array([np.mean(v) for v in by_u.values()], dtype=np.float64),
        np.array([len(v) for v in by_u.values()], dtype=np.float64),
    )


class Surrogate:
    """Posterior of the response with fixed hyper-parameters."""

    def __init__(self, data: TrainingSet, hyper: Hyperparameters, link: Link | None = None) -> None:
        self.data, self.hyper, self.link = data, hyper, link
        self._target = data.y - hyper.offset - self._linked(data.u)
        self._gp = GaussianProcessRegressor(
            _kernel(hyper.amplitude, hyper.length_scales, hyper.slope),
            alpha=hyper.noise_sd**2 / data.n,
            optimizer=None,
        ).fit(data.u - 0.5, self._target)
        inverse = cho_solve((self._gp.L_, True), np.eye(len(data.y)))
        # Leave-one-out in closed form (Rasmussen and Williams 2006, eq. 5.12): y_i - m_-i = (K^-1 y)_i / K^-1_ii,
        # with variance 1 / K^-1_ii, the noise of the mean that was left out included.
        self.loo_residuals: FloatArray = inverse @ self._target / np.diag(inverse)
        self.loo_z: FloatArray = self.loo_residuals * np.sqrt(np.diag(inverse))

    def predict(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and sd of the noiseless response at u (k, d), not inflated."""
        if len(u) == 0:
            return np.empty(0), np.empty(0)
        mean, sd = self._gp.predict(u - 0.5, return_std=True)
        return mean + self.hyper.offset + self._linked(u), np.maximum(sd, 1e-9)

    def mean(self, u: FloatArray) -> FloatArray:
        """The mean alone, a tenth of the work."""
        return np.asarray(self._gp.predict(u - 0.5) + self.hyper.offset + self._linked(u))

    def covariance(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean (k,) and covariance (k, k) of the noiseless response."""
        mean, covariance = self._gp.predict(u - 0.5, return_cov=True)
        return mean + self.hyper.offset + self._linked(u), covariance

    @property
    def inflation(self) -> float:
        """Factor on every sd before anything is certified: max(1, sd of the leave-one-out z)."""
        return max(1.0, float(np.std(self.loo_z))) if len(self.loo_z) > 2 else 1.0

    @property
    def loo_error(self) -> float:
        """Root mean square of what each group misses when it is left out, unit."""
        return float(np.sqrt(np.mean(self.loo_residuals**2)))

    def with_runs(self, rows: Iterable[tuple[tuple[float, ...], float]]) -> Surrogate:
        """The same hyper-parameters, conditioned on more runs (u, response)."""
        u, y, n = (list(part) for part in self.data)
        for point, value in rows:
            same = [i for i, known in enumerate(u) if tuple(known) == point]
            if same:
                i = same[0]
                y[i], n[i] = (y[i] * n[i] + value) / (n[i] + 1.0), n[i] + 1.0
            else:
                u.append(np.array(point))
                y.append(value)
                n.append(1.0)
        return Surrogate(TrainingSet(np.array(u), np.array(y), np.array(n)), self.hyper, self.link)

    def _linked(self, u: FloatArray) -> FloatArray:
        return np.zeros(len(u)) if self.link is None else self.link(u)


def fit_hyperparameters(
    data: TrainingSet,
    noise: NoiseEvidence,
    unit: float = 1.0,
    prior: Prior = RESPONSE,
    link: Link | None = None,
) -> Hyperparameters:
    """Maximum a posteriori amplitude, length scales and noise. `unit`: what the priors call a degree."""
    d = data.u.shape[1]
    target = data.y if link is None else data.y - link(data.u)
    offset = float(np.mean(target))
    kernel = _kernel(prior.amplitude[0], (LENGTH_PRIOR[0],) * d, prior.slope)
    scaled, squares = (target - offset) / unit, noise.squares / unit**2
    # theta = (log a^2, log l_1 ... log l_d): the amplitude's prior has twice its location and spread.
    centre = np.log(np.array([prior.amplitude[0] ** 2] + [LENGTH_PRIOR[0]] * d))
    spread = np.array([2.0 * prior.amplitude[1]] + [LENGTH_PRIOR[1]] * d)

    def minus_log_posterior(theta: FloatArray) -> tuple[float, FloatArray]:
        log_variance = theta[-1]
        value, gradient = _log_likelihood(kernel.clone_with_theta(theta[:-1]), log_variance, data, scaled)
        z = (theta[:-1] - centre) / spread
        per_variance = squares * np.exp(-log_variance)
        value -= 0.5 * (z @ z + noise.freedom * log_variance + per_variance)
        gradient -= np.append(z / spread, 0.5 * (noise.freedom - per_variance))
        return -value, -gradient

    start = np.append(kernel.theta, np.log(squares / noise.freedom))
    low, high = NOISE_BOUNDS
    bounds = np.vstack([kernel.bounds, 2.0 * np.log([[low, high]])])
    # Not through scikit-learn's own optimizer: it knows no priors and warns whenever a bound is near.
    theta = minimize(
        minus_log_posterior,
        np.clip(start, bounds[:, 0], bounds[:, 1]),
        jac=True,
        bounds=bounds,
        method="L-BFGS-B",
        options={"maxiter": 40},
    ).x
    return Hyperparameters(
        amplitude=unit * float(np.exp(0.5 * theta[0])),
        length_scales=tuple(float(v) for v in np.exp(theta[1:-1])),
        noise_sd=unit * float(np.exp(0.5 * theta[-1])),
        offset=offset,
        slope=unit * prior.slope,
    )


def _log_likelihood(
    kernel: Any, log_variance: float, data: TrainingSet, y: FloatArray
) -> tuple[float, FloatArray]:
    """Rasmussen and Williams (2006), eqs. 2.30 and 5.9; the last gradient is by log sigma^2."""
    alpha = np.exp(log_variance) / data.n
    matrix, slopes = kernel(data.u - 0.5, eval_gradient=True)
    try:
        lower = cholesky(matrix + np.diag(alpha), lower=True)
    except LinAlgError:
        return -1e25, np.zeros(slopes.shape[2] + 1)
    weights = cho_solve((lower, True), y)
    inner = np.outer(weights, weights) - cho_solve((lower, True), np.eye(len(y)))
    value = -0.5 * y @ weights - np.sum(np.log(np.diag(lower))) - 0.5 * len(y) * np.log(2.0 * np.pi)
    gradient = 0.5 * np.einsum("ij,ijk->k", inner, slopes)
    return float(value), np.append(gradient, 0.5 * np.sum(np.diag(inner) * alpha))


def _kernel(amplitude: float, lengths: tuple[float, ...], slope: float) -> Any:
    low, high = AMPLITUDE_BOUNDS
    smooth = ConstantKernel(amplitude**2, (low**2, high**2)) * Matern(lengths, LENGTH_BOUNDS, nu=2.5)
    return smooth + ConstantKernel(slope**2, "fixed") * DotProduct(0.5, "fixed")

"""The Gaussian process on the angle (calibration.md decision 2); the only file that imports scikit-learn.

Notation (G groups of replicates, d variables)
    u       designs in the unit cube                                     (G, d)
    y       mean angle of each group, degrees                            (G,)
    n       runs behind each mean                                        (G,)
    sigma   noise sd of one run, degrees; alpha = sigma^2 / n            (G,)
    c       offset: mean of y
    a, l    amplitude (deg) and length scales of the Matern 5/2 part     scalar, (d,)
    w       sd of the slopes of the linear trend, degrees per box width
    K       kernel matrix with alpha on its diagonal                     (G, G)
    m, s    posterior mean and sd of the noiseless angle, degrees

Model: `y - c ~ N(0, a^2 Matern(u, u'; l) + w^2 (1/4 + v.v') + alpha)` with v = u - 1/2. The trend is a
Bayesian linear regression inside the kernel: intercept sd w/2 about the data's mean, slope sd w.

Hyper-parameters maximise likelihood times log-normal priors. The priors are in degrees because the response
is an angle: they keep the fit stable with five points, where the likelihood alone would choose noise-free
interpolation or a constant.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import cho_solve
from scipy.optimize import minimize
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, DotProduct, Matern

from worker.optimizer.design import FloatArray

TREND_SLOPE_DEG = 8.0
AMPLITUDE_BOUNDS_DEG = (0.3, 20.0)
LENGTH_BOUNDS = (0.1, 10.0)
# Median and sd (of the logarithm) of the priors.
AMPLITUDE_PRIOR = (5.0, 0.5)
LENGTH_PRIOR = (1.0, 0.5)


class TrainingSet(NamedTuple):
    """Group means with the number of runs behind each."""

    u: FloatArray
    y: FloatArray
    n: FloatArray


class Hyperparameters(NamedTuple):
    """All that, beside the training set, determines the surrogate."""

    amplitude_deg: float
    length_scales: tuple[float, ...]
    noise_sd_deg: float
    offset_deg: float

    def as_dict(self) -> dict[str, Any]:
        return {**self._asdict(), "length_scales": list(self.length_scales)}

    @classmethod
    def from_dict(cls, stored: dict[str, Any]) -> Hyperparameters:
        return cls(
            float(stored["amplitude_deg"]),
            tuple(float(v) for v in stored["length_scales"]),
            float(stored["noise_sd_deg"]),
            float(stored["offset_deg"]),
        )


def training_set(rows: Iterable[tuple[tuple[float, ...], float]]) -> TrainingSet:
    """Group single runs (u, angle) by u."""
    by_u: dict[tuple[float, ...], list[float]] = {}
    for u, angle in rows:
        by_u.setdefault(u, []).append(angle)
    return TrainingSet(
        np.array(list(by_u), dtype=np.float64),
        np.array([np.mean(v) for v in by_u.values()], dtype=np.float64),
        np.array([len(v) for v in by_u.values()], dtype=np.float64),
    )


class Surrogate:
    """Posterior of the angle with fixed hyper-parameters."""

    def __init__(self, data: TrainingSet, hyper: Hyperparameters) -> None:
        self.data, self.hyper = data, hyper
        self._gp = GaussianProcessRegressor(
            _kernel(hyper.amplitude_deg, hyper.length_scales),
            alpha=hyper.noise_sd_deg**2 / data.n,
            optimizer=None,
        ).fit(data.u - 0.5, data.y - hyper.offset_deg)
        self.loo_z = self._leave_one_out()

    def predict(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and sd of the noiseless angle at u (k, d), not inflated."""
        if len(u) == 0:
            return np.empty(0), np.empty(0)
        mean, sd = self._gp.predict(u - 0.5, return_std=True)
        return mean + self.hyper.offset_deg, np.maximum(sd, 1e-9)

    def covariance(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean (k,) and covariance (k, k) of the noiseless angle."""
        mean, covariance = self._gp.predict(u - 0.5, return_cov=True)
        return mean + self.hyper.offset_deg, covariance

    @property
    def inflation(self) -> float:
        """Factor on every sd before anything is certified: max(1, sd of the leave-one-out z)."""
        return max(1.0, float(np.std(self.loo_z))) if len(self.loo_z) > 2 else 1.0

    def with_runs(self, rows: Iterable[tuple[tuple[float, ...], float]]) -> Surrogate:
        """The same hyper-parameters, conditioned on more runs (u, angle)."""
        u, y, n = (list(part) for part in self.data)
        for point, angle in rows:
            same = [i for i, known in enumerate(u) if tuple(known) == point]
            if same:
                i = same[0]
                y[i], n[i] = (y[i] * n[i] + angle) / (n[i] + 1.0), n[i] + 1.0
            else:
                u.append(np.array(point))
                y.append(angle)
                n.append(1.0)
        return Surrogate(TrainingSet(np.array(u), np.array(y), np.array(n)), self.hyper)

    def _leave_one_out(self) -> FloatArray:
        """z_i = (y_i - m_-i) / sd_-i in closed form: `(K^-1 y)_i / sqrt((K^-1)_ii)`.

        Rasmussen and Williams (2006), eq. 5.12; the sd includes the noise of the mean that was left out.
        """
        inverse = cho_solve((self._gp.L_, True), np.eye(len(self.data.y)))
        residual: FloatArray = inverse @ (self.data.y - self.hyper.offset_deg)
        return residual / np.sqrt(np.diag(inverse))


def fit_hyperparameters(data: TrainingSet, noise_sd_deg: float) -> Hyperparameters:
    """Maximum a posteriori amplitude and length scales; the noise stays as given."""
    d = data.u.shape[1]
    offset = float(np.mean(data.y))
    gp = GaussianProcessRegressor(
        _kernel(AMPLITUDE_PRIOR[0], (LENGTH_PRIOR[0],) * d), alpha=noise_sd_deg**2 / data.n, optimizer=None
    ).fit(data.u - 0.5, data.y - offset)
    # theta = (log a^2, log l_1 ... log l_d): the amplitude's prior has twice its location and spread.
    centre = np.log(np.array([AMPLITUDE_PRIOR[0] ** 2] + [LENGTH_PRIOR[0]] * d))
    spread = np.array([2.0 * AMPLITUDE_PRIOR[1]] + [LENGTH_PRIOR[1]] * d)

    def minus_log_posterior(theta: FloatArray) -> tuple[float, FloatArray]:
        value, gradient = gp.log_marginal_likelihood(theta, eval_gradient=True, clone_kernel=False)
        z = (theta - centre) / spread
        return float(0.5 * z @ z - value), z / spread - gradient

    # Not through scikit-learn's own optimizer: it knows no priors and warns whenever a bound is near.
    theta = minimize(
        minus_log_posterior,
        gp.kernel_.theta,
        jac=True,
        bounds=gp.kernel_.bounds,
        method="L-BFGS-B",
        options={"maxiter": 40},
    ).x
    lengths = tuple(float(v) for v in np.exp(theta[1:]))
    return Hyperparameters(float(np.exp(0.5 * theta[0])), lengths, noise_sd_deg, offset)


def _kernel(amplitude_deg: float, lengths: tuple[float, ...]) -> Any:
    low, high = AMPLITUDE_BOUNDS_DEG
    smooth = ConstantKernel(amplitude_deg**2, (low**2, high**2)) * Matern(lengths, LENGTH_BOUNDS, nu=2.5)
    slope = ConstantKernel(TREND_SLOPE_DEG**2, "fixed") * DotProduct(0.5, "fixed")
    return smooth + slope

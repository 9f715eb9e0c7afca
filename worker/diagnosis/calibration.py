"""Re-calibration of the baseline, and what it can absorb (rule 4).

Notation (N cells, D parameters in their unit boxes)
    y, m, J     measured means; emulated means and slopes at theta
    W           covariance of y - m without the parameters: noise + emulator + floor          (N, N)
    V0          prior of theta: mean 1/2, variance 1/12 each, that of the uniform box
    V           W + J V0 J': what is left of a misfit after re-calibration is what V does not explain
    r           y - m(theta) + J (theta - 1/2): the residual about the prior's middle, so that theta ~ N(1/2, V0)

`theta_hat` minimises (y - m)' W^-1 (y - m) + |theta - 1/2|^2 / V0 by damped Gauss-Newton inside the box.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from worker.diagnosis.model import Model
from worker.diagnosis.simulator import FloatArray

PRIOR_VARIANCE = 1.0 / 12.0
_STEPS = 12
# A gain in chi-square that is not worth another step.
_ENOUGH = 0.02


class Linearised(NamedTuple):
    """The problem at theta (D,): r, V, W, J as in the notation block."""

    theta: FloatArray
    r: FloatArray
    J: FloatArray
    W: FloatArray
    V: FloatArray

    @property
    def posterior(self) -> FloatArray:
        """Covariance (D, D) of theta without effects."""
        factor = cho_factor(self.W, lower=True)
        precision = self.J.T @ cho_solve(factor, self.J) + np.eye(len(self.theta)) / PRIOR_VARIANCE
        return np.asarray(np.linalg.inv(precision), dtype=np.float64)

    def shifted(self, change: FloatArray) -> FloatArray:
        """theta when `change` (N,) is taken off the measured means, in the box."""
        factor = cho_factor(self.V, lower=True)
        moved = PRIOR_VARIANCE * self.J.T @ cho_solve(factor, self.r - change)
        return np.asarray(np.clip(0.5 + moved, 0.0, 1.0))

    @property
    def misfit(self) -> float:
        """r' V^-1 r."""
        L = np.linalg.cholesky(self.V)
        return float(np.sum(solve_triangular(L, self.r, lower=True) ** 2))


def linearise(model: Model, y: FloatArray, fixed: FloatArray, theta: FloatArray) -> Linearised:
    """At theta (D,); `fixed` (N, N) is the noise and the floor."""
    m, J = model.tangent(theta)
    W = fixed + model.error(theta)
    r = y - m + J @ (theta - 0.5)
    return Linearised(theta, r, J, W, W + PRIOR_VARIANCE * J @ J.T)


def calibrate(model: Model, y: FloatArray, fixed: FloatArray, start: FloatArray | None = None) -> FloatArray:
    """theta_hat (D,), from `start` or the best emulated design of each material."""
    theta = _best_designs(model, y, fixed) if start is None else start
    factor = cho_factor(fixed + model.error(theta), lower=True)
    objective = _objective(model, y, factor, theta)
    damping = 1e-3
    for _ in range(_STEPS):
        m, J = model.tangent(theta)
        solved = cho_solve(factor, np.column_stack([y - m, J]))
        H = J.T @ solved[:, 1:] + np.eye(len(theta)) / PRIOR_VARIANCE
        gradient = J.T @ solved[:, 0] + (0.5 - theta) / PRIOR_VARIANCE
        H += damping * np.diag(np.diag(H))
        trial = np.clip(theta + _inside_step(H, gradient, theta), 0.0, 1.0)
        value = _objective(model, y, factor, trial)
        if value < objective:
            gained, theta, objective = objective - value, trial, value
            damping = max(damping / 5.0, 1e-6)
            if gained < _ENOUGH:
                break
        else:
            damping *= 10.0
            if damping > 1e4:
                break
    return theta


def _inside_step(H: FloatArray, gradient: FloatArray, theta: FloatArray) -> FloatArray:
    """The Newton step of the parameters that are not held at a face of the box."""
    free = ~(((theta <= 0.0) & (gradient < 0.0)) | ((theta >= 1.0) & (gradient > 0.0)))
    step = np.zeros_like(theta)
    if free.any():
        step[free] = np.linalg.solve(H[np.ix_(free, free)], gradient[free])
    return step


Factor = tuple[FloatArray, bool]


def _objective(model: Model, y: FloatArray, factor: Factor, theta: FloatArray) -> float:
    misfit = y - model.mean(theta)
    prior = float(np.sum((theta - 0.5) ** 2)) / PRIOR_VARIANCE
    return float(misfit @ cho_solve(factor, misfit)) + prior


def _best_designs(model: Model, y: FloatArray, fixed: FloatArray) -> FloatArray:
    """For each material the design whose own run-free means fit its cells best."""
    sd = np.sqrt(np.diag(fixed))
    names = np.array([model.frame.conditions[c].material for c in model.frame.condition])
    found = []
    for material, emulator in zip(model.materials, model.emulators, strict=True):
        cells = names == material
        if not cells.any():
            found.append(np.full(model.dimension, 0.5))
            continue
        misfit = (y[cells] - emulator.mean(emulator.u)) / sd[cells]
        found.append(emulator.u[np.argmin(np.sum(misfit**2, axis=1))])
    return np.concatenate(found)

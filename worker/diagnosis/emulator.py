"""Emulators of all summaries over the calibration parameters, cheap because all share one design (rule 3).

Notation (n runs, d parameters of one material, N cells of its conditions; "unit" is the cell's)
    u       designs in the unit cube                                          (n, d)
    Y       summaries of the runs, centred by c and divided by their spread w (n, N)
    B       quadratic trend: 1, v_j, v_j v_k with v = u - 1/2, prior sd 3, 3, 2
    K       B B' + b^2 exp(-|u - u'|^2 / 2 l^2), eigenvectors Q, eigenvalues e; noise g times the identity
    sigma^2 scale of everything, at its most likely value for given l, b, g

Length l, amplitude b and noise g are chosen for each cell from a small grid by marginal likelihood: one
eigendecomposition for each (l, b) serves all cells.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from worker.diagnosis.simulator import FloatArray

_LENGTHS = (0.5, 1.2)
_AMPLITUDES = (0.1, 0.5)
_NOISES = tuple(10.0**k for k in (-5.0, -4.0, -3.0, -2.5, -2.0, -1.5, -1.0, -0.5, 0.0, 0.5))
_TREND_SD = (3.0, 3.0, 2.0)
_NORMAL_90 = 1.6449
_STEP = 0.02


class _Kernel(NamedTuple):
    length: float
    amplitude: float

    def rest(self, square: FloatArray) -> FloatArray:
        """What is not trend, from squared distances."""
        return np.asarray(self.amplitude**2 * np.exp(-0.5 * square / self.length**2))

    def __call__(self, u: FloatArray, other: FloatArray) -> FloatArray:
        return np.asarray(_trend(u) @ _trend(other).T + self.rest(_square_distance(u, other)))


def _square_distance(u: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(np.sum((u[:, None, :] - other[None, :, :]) ** 2, axis=2))


def _trend(u: FloatArray) -> FloatArray:
    v = u - 0.5
    first, second = np.triu_indices(u.shape[1])
    ones = np.full((len(u), 1), _TREND_SD[0])
    return np.concatenate([ones, _TREND_SD[1] * v, _TREND_SD[2] * v[:, first] * v[:, second]], axis=1)


class _Group(NamedTuple):
    """Cells that share a kernel: their columns, weights K^-1 Y (n, k), noise g (k,), scale (k,)."""

    kernel: _Kernel
    Q: FloatArray
    e: FloatArray
    columns: NDArray[np.intp]
    weights: FloatArray
    g: FloatArray
    scale: FloatArray


@dataclass(frozen=True)
class Emulator:
    """Of the cells of one material. `left_out` (n, N) are the leave-one-out residuals, in the cell's unit, and
    `left_out_sd` (n, N) what was predicted for them, noise of a run included."""

    u: FloatArray
    centre: FloatArray
    spread: FloatArray
    groups: tuple[_Group, ...]
    left_out: FloatArray
    left_out_sd: FloatArray

    def predict(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and variance (k, N) of the noiseless summaries at u (k, d)."""
        mean = np.empty((len(u), len(self.centre)))
        variance = np.empty_like(mean)
        for group, k in self._kernels(u):
            own = np.sum(_trend(u) ** 2, axis=1) + group.kernel.amplitude**2
            reach = (k @ group.Q) ** 2
            shrunk = reach @ (1.0 / (group.e[:, None] + group.g[None, :]))
            mean[:, group.columns] = k @ group.weights
            variance[:, group.columns] = np.maximum(own[:, None] - shrunk, 0.0) * group.scale
        return self.centre + self.spread * mean, self.spread**2 * variance

    def mean(self, u: FloatArray) -> FloatArray:
        """Means (k, N) at u (k, d)."""
        found = np.empty((len(u), len(self.centre)))
        for group, k in self._kernels(u):
            found[:, group.columns] = k @ group.weights
        return self.centre + self.spread * found

    def _kernels(self, u: FloatArray) -> Iterator[tuple[_Group, FloatArray]]:
        """Each group with its kernel (k, n) between u and the runs; the trend and the distances only once."""
        trend = _trend(u) @ self._trend.T
        square = _square_distance(u, self.u)
        for group in self.groups:
            yield group, trend + group.kernel.rest(square)

    @cached_property
    def _trend(self) -> FloatArray:
        return _trend(self.u)

    def tangent(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Means (N,) and slopes (N, d) at one point u (d,), the slopes by central differences."""
        steps = _STEP * np.eye(len(u))
        found = self.mean(np.vstack([u[None, :], u + steps, u - steps]))
        ahead, behind = found[1 : len(u) + 1], found[len(u) + 1 :]
        return found[0], np.asarray((ahead - behind).T / (2.0 * _STEP))

    @property
    def run_noise(self) -> FloatArray:
        """sd (N,) of one run about the noiseless summary, as fitted."""
        found = np.empty(len(self.centre))
        for group in self.groups:
            found[group.columns] = np.sqrt(group.g * group.scale)
        return self.spread * found

    def coverage(self, last: int) -> float:
        """Share of the last so many runs inside their leave-one-out 90 % bands, all cells together."""
        inside = np.abs(self.left_out[-last:]) <= _NORMAL_90 * self.left_out_sd[-last:]
        return float(np.mean(inside)) if inside.size else 1.0


def fit(u: FloatArray, Y: FloatArray) -> Emulator:
    """From runs at u (n, d) with summaries Y (n, N), all finite; N is 0 for a material without cells."""
    n = len(u)
    centre = np.mean(Y, axis=0)
    spread = np.maximum(np.std(Y, axis=0), 1e-12)
    Z = (Y - centre) / spread
    kernels = [_Kernel(length, b) for length in _LENGTHS for b in _AMPLITUDES]
    parts = [np.linalg.eigh(kernel(u, u)) for kernel in kernels]
    turned = [Q.T @ Z for _, Q in parts]
    g = np.array(_NOISES)
    merits, scales = [], []
    for (e, _), T in zip(parts, turned, strict=True):
        d = np.maximum(e, 0.0)[:, None] + g
        scale = (1.0 / d).T @ T**2 / n
        merits.append(-0.5 * n * np.log(np.maximum(scale, 1e-300)) - 0.5 * np.sum(np.log(d), axis=0)[:, None])
        scales.append(scale)
    merit = np.stack(merits)  # (kernels, noises, N)
    best = np.argmax(merit.reshape(len(kernels) * len(g), Z.shape[1]), axis=0)
    which, level = np.divmod(best, len(g))
    groups, out, out_sd = [], np.empty_like(Z), np.empty_like(Z)
    for k, kernel in enumerate(kernels):
        columns = np.flatnonzero(which == k)
        if not len(columns):
            continue
        e, Q = np.maximum(parts[k][0], 0.0), parts[k][1]
        noise = g[level[columns]]
        scale = scales[k][level[columns], columns]
        inverse = 1.0 / (e[:, None] + noise)
        weights = Q @ (inverse * turned[k][:, columns])
        diagonal = Q**2 @ inverse
        out[:, columns] = weights / diagonal
        out_sd[:, columns] = np.sqrt(scale / diagonal)
        groups.append(_Group(kernel, Q, e, columns, weights, noise, scale))
    return Emulator(u, centre, spread, tuple(groups), out * spread, out_sd * spread)

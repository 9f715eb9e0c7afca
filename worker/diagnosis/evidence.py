"""Evidence for one effect and for two (rule 6), from residuals and fingerprints.

Notation (N cells, K directions of effects; whitened by L of V = L L')
    r, f        residual (N,), fingerprints (K, N)
    q = f.r     (K,), and S = f.f (K, K), both under V^-1; s its diagonal
    tau         scale of the half-normal prior of an amplitude a > 0                                  (K,)
    v, m        posterior variance and mean without the bound: v = 1/(s + tau^-2), m = q v
    log BF      m^2/(2v) + ln(v/tau^2)/2 + ln(2 Phi(m/sqrt(v)))

Two effects: with Lambda = S + diag(tau^-2), mu = Lambda^-1 q,
    log BF = mu' Lambda mu / 2 - ln det(Lambda)/2 - ln(tau_a tau_b) + ln(4 P(a > 0, b > 0)),
P the quadrant's probability under N(mu, Lambda^-1) (Drezner & Wesolowsky 1990). An effect of either sign, or of
any azimuth, is several directions f with one amplitude a > 0 each.

A fingerprint is uncertain: by its seeds, and because no model has the law of the plant (`FORM_ERROR`, relative in
each cell). At the fitted amplitude that is a covariance G = a^2 diag(w C + delta^2 f^2) added to V; the evidence
is then ln N(r; 0, V + G) - ln N(r; 0, V) + log BF under V + G, so that all models are compared on the same data.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import log_ndtr, ndtr

from worker.diagnosis.simulator import FloatArray

FORM_ERROR = 0.2
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(20)
# Beyond this the quadrant holds next to nothing, and the pair is no better than one effect alone.
_FARTHEST = -2.0


class Whitened(NamedTuple):
    """L^-1 r (N,) and the logarithm of N(r; 0, V) up to a constant."""

    L: FloatArray
    r: FloatArray
    log_density: float

    def of(self, f: FloatArray) -> FloatArray:
        """L^-1 f for the rows of f (K, N)."""
        return np.asarray(solve_triangular(self.L, f.T, lower=True, check_finite=False).T)


def whiten(r: FloatArray, V: FloatArray) -> Whitened:
    """Of a residual r (N,) with covariance V (N, N)."""
    L = np.asarray(np.linalg.cholesky(V), dtype=np.float64)
    white = solve_triangular(L, r, lower=True, check_finite=False)
    return Whitened(L, white, -0.5 * float(white @ white) - float(np.sum(np.log(np.diag(L)))))


def log_bayes_single(q: FloatArray, s: FloatArray, tau: FloatArray) -> FloatArray:
    """log BF of one effect against none, elementwise."""
    v = 1.0 / (s + tau**-2.0)
    m = q * v
    return np.asarray(0.5 * m**2 / v + 0.5 * np.log(v / tau**2) + math.log(2.0) + log_ndtr(m / np.sqrt(v)))


def amplitude_single(q: FloatArray, s: FloatArray, tau: FloatArray) -> FloatArray:
    """Posterior mode of the amplitude, 0 or more."""
    return np.asarray(np.maximum(q / (s + tau**-2.0), 0.0))


class Pairs(NamedTuple):
    """Of every two directions: log BF (K, K), -inf where the quadrant is nearly empty, and the means (K, K) of the
    first amplitude of each pair."""

    log_bayes: FloatArray
    first: FloatArray


def log_bayes_pairs(q: FloatArray, S: FloatArray, tau: FloatArray) -> Pairs:
    """Of all pairs of K directions against none."""
    a = np.diag(S) + tau**-2.0
    det = np.maximum(np.outer(a, a) - S**2, 1e-12 * np.outer(a, a))
    first = (a[None, :] * q[:, None] - S * q[None, :]) / det
    second = first.T
    fit = 0.5 * (first * q[:, None] + second * q[None, :])
    sd = np.sqrt(a[None, :] / det)
    h, k = first / sd, second / sd.T
    rho = np.clip(-S / np.sqrt(np.outer(a, a)), -0.9999, 0.9999)
    empty = (h < _FARTHEST) | (k < _FARTHEST) | ((h < 0.0) & (k < 0.0))
    inside = np.log(np.maximum(4.0 * quadrant(h, k, rho), 1e-12))
    log_bayes = fit - 0.5 * np.log(det) - np.log(np.outer(tau, tau)) + inside
    return Pairs(np.where(empty, -np.inf, log_bayes), first)


def quadrant(h: FloatArray, k: FloatArray, rho: FloatArray) -> FloatArray:
    """P(X < h, Y < k) of standard normals with correlation rho: Phi(h) Phi(k) + an integral over rho."""
    reach = np.arcsin(rho)
    angle = 0.5 * reach[..., None] * (1.0 + _NODES)
    sine = np.sin(angle)
    square = h[..., None] ** 2 + k[..., None] ** 2 - 2.0 * h[..., None] * k[..., None] * sine
    inner = np.exp(-0.5 * square / (1.0 - sine**2))
    extra = 0.5 * reach * np.sum(_WEIGHTS * inner, axis=-1) / (2.0 * np.pi)
    return np.asarray(np.clip(ndtr(h) * ndtr(k) + extra, 0.0, 1.0))


def form_variance(f: FloatArray, amplitude: float, seeds: FloatArray) -> FloatArray:
    """Diagonal of G (N,) of one effect; `seeds` (N,) is that of its w C."""
    return np.asarray(amplitude**2 * (seeds + (FORM_ERROR * f) ** 2))

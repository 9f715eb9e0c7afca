"""Closed forms for a response f ~ N(m, s^2) that should meet a target t.

Notation (all angles in degrees; arrays broadcast)
    m, s     posterior mean and sd of the noiseless response at a design
    t        target;  [lo, hi] the window;  tol the tolerance of the certificate
    b        smallest E|f - t| over the evaluated designs
    sigma    noise sd of one run;  r further runs at the design
    lam      inflation of the posterior sd
    s_r      sd left after r runs: 1/s_r^2 = 1/s^2 + r/sigma^2
Phi and phi are the standard normal distribution and density.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtr, ndtri

from service.domain.study import Response
from worker.optimizer.design import FloatArray

WINDOW_PROBABILITY = 0.99
# E|f - t| <= tol alone would let a mean .45 deg off pass at tol .5: of the sinter's certified designs only
# 60 % were truly within .5 deg. A certificate is to hold in 85 % of studies, so that much is asked for.
TOLERANCE_PROBABILITY = 0.85


def _density(z: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi))


def expected_miss(m: FloatArray, s: FloatArray, t: float) -> FloatArray:
    """`E|f - t| = (m - t)(1 - 2 Phi(c)) + 2 s phi(c)`, c = (t - m)/s: the mean of a folded normal."""
    c = (t - m) / s
    return np.asarray((m - t) * (1.0 - 2.0 * ndtr(c)) + 2.0 * s * _density(c))


def expected_improvement(m: FloatArray, s: FloatArray, t: float, b: float) -> FloatArray:
    """`E max(0, b - |f - t|)` (calibration.md decision 1); a, c, d: bounds and centre in units of s."""
    a, c, d = (t - b - m) / s, (t - m) / s, (t + b - m) / s
    below = (b - t + m) * (ndtr(c) - ndtr(a)) + s * (_density(a) - _density(c))
    above = (b + t - m) * (ndtr(d) - ndtr(c)) - s * (_density(c) - _density(d))
    return np.asarray(np.maximum(below + above, 0.0))


def minimum_improvement(m: FloatArray, s: FloatArray, b: float) -> FloatArray:
    """`E max(0, b - f) = (b - m) Phi(z) + s phi(z)`, z = (b - m)/s: the usual EI, for the rivals."""
    z = (b - m) / s
    return np.asarray((b - m) * ndtr(z) + s * _density(z))


def window_probability(m: FloatArray, s: FloatArray, window: tuple[float, float]) -> FloatArray:
    """P(lo <= f <= hi)."""
    return np.asarray(ndtr((window[1] - m) / s) - ndtr((window[0] - m) / s))


def _central_margins(probability: float) -> tuple[FloatArray, FloatArray]:
    """Table of the largest |m - c| / h that keeps P(|f - c| <= h) >= probability, against s / h."""
    widest = 1.0 / float(ndtri(0.5 + 0.5 * probability))
    ratios = np.linspace(0.0, widest, 200)
    s = np.maximum(ratios, 1e-9)
    low, high = np.zeros_like(ratios), np.ones_like(ratios)
    for _ in range(40):
        middle = 0.5 * (low + high)
        good = window_probability(middle, s, (-1.0, 1.0)) >= probability
        low, high = np.where(good, middle, low), np.where(good, high, middle)
    return ratios, low


_WINDOW_TABLE = _central_margins(WINDOW_PROBABILITY)
_TOLERANCE_TABLE = _central_margins(TOLERANCE_PROBABILITY)


def _central(
    s: FloatArray, lower: float, upper: float, table: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    centre, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    margin = half * np.interp(s / half, *table, right=-1.0)
    return centre - margin, centre + margin


def certifiable_means(s: FloatArray, response: Response) -> tuple[FloatArray, FloatArray]:
    """The interval of posterior means that a certificate allows at the inflated sd s; empty if reversed."""
    t, tol = response.target, response.tolerance
    near = _central(s, t - tol, t + tol, _TOLERANCE_TABLE)
    inside = _central(s, *response.window, _WINDOW_TABLE)
    return np.maximum(near[0], inside[0]), np.minimum(near[1], inside[1])


def seeds_for_certificate(sigma: float, response: Response) -> int:
    """Seeds after which a design in the middle of its window could be certified on their mean alone."""
    lower, upper = response.window
    from_window = 0.5 * (upper - lower) * float(_WINDOW_TABLE[0][-1])
    from_tolerance = response.tolerance * float(_TOLERANCE_TABLE[0][-1])
    return math.ceil((sigma / float(min(from_window, from_tolerance))) ** 2)


def certificate_chance(
    m: FloatArray, s: FloatArray, r: int, sigma: float, lam: float, response: Response
) -> FloatArray:
    """Chance that r further runs at a design leave its posterior good enough for the certificate.

    The posterior mean after r runs is, seen from now, N(m, s^2 - s_r^2).
    """
    s_r = 1.0 / np.sqrt(1.0 / s**2 + r / sigma**2)
    move = lam * np.sqrt(np.maximum(s**2 - s_r**2, 1e-18))
    lower, upper = certifiable_means(lam * s_r, response)
    chance = ndtr((upper - m) / move) - ndtr((lower - m) / move)
    return np.asarray(np.where(upper > lower, chance, 0.0))


def effort(
    m: FloatArray,
    s: FloatArray,
    missing: FloatArray,
    most: int,
    sigma: float,
    lam: float,
    response: Response,
) -> tuple[FloatArray, FloatArray]:
    """Simulations per certificate of the best plan "r runs here, then look": min over r of r / chance.

    missing (k,): seeds a design lacks for the certificate's count. most: runs left. Returns the effort (k,),
    infinite where no plan has a chance, and the best chance of any plan (k,).
    """
    best, highest = np.full(len(m), np.inf), np.zeros(len(m))
    for r in range(1, most + 1):
        chance = np.where(missing <= r, certificate_chance(m, s, r, sigma, lam, response), 0.0)
        highest = np.maximum(highest, chance)
        best = np.minimum(best, r / np.maximum(chance, 1e-12))
    return best, highest

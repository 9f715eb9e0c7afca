"""Closed forms for a response f ~ N(m, s^2) that should meet a target t, and their means over several responses.

Notation (all in the response's unit; arrays broadcast)
    m, s     posterior mean and sd of the noiseless response at a design
    t        target;  [lo, hi] the window;  tol the tolerance of the certificate
    b        smallest E|f - t| over the evaluated designs
    sigma    noise sd of one run;  r further runs at the design
    lam      inflation of the posterior sd
    s_r      sd left after r runs: 1/s_r^2 = 1/s^2 + r/sigma^2
    tau      sd with which a response counts: tau^2 = (sd of the lab's value)^2 + (model discrepancy sd)^2
    chi      sqrt(sum_j ((f_j - t_j) / tau_j)^2) over several responses: |f - t| / tau if there is one
    z_q      Q fixed standard normals (Q, responses), scrambled Sobol points
Phi and phi are the standard normal distribution and density.

Nobody states how far the simulation may be from the material when all parameters are right. The window does: a
result inside it is accepted, so a quarter of its width is read as the discrepancy's sd (window = t +- 2 sd).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from service.domain.study import Response
from worker.optimizer.design import STREAM_NORMALS, FloatArray, sobol

WINDOW_PROBABILITY = 0.99
# E|f - t| <= tol alone would let a mean .45 deg off pass at tol .5: of the sinter's certified designs only
# 60 % were truly within .5 deg. A certificate is to hold in 85 % of studies, so that much is asked for.
TOLERANCE_PROBABILITY = 0.85
# Sobol normals behind each mean over several responses; a power of two.
NORMALS = 256


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


@lru_cache(maxsize=8)
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


def _central(s: FloatArray, lower: float, upper: float, probability: float) -> tuple[FloatArray, FloatArray]:
    centre, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    margin = half * np.interp(s / half, *_central_margins(probability), right=-1.0)
    return centre - margin, centre + margin


def certifiable_means(s: FloatArray, response: Response, among: int = 1) -> tuple[FloatArray, FloatArray]:
    """The interval of posterior means that a certificate allows at the inflated sd s; empty if reversed.

    `among` responses share the chance of a window: each is asked for `.99 ** (1 / among)`.
    """
    t, tol = response.target, response.tolerance
    near = _central(s, t - tol, t + tol, TOLERANCE_PROBABILITY)
    inside = _central(s, *response.window, WINDOW_PROBABILITY ** (1.0 / among))
    return np.maximum(near[0], inside[0]), np.minimum(near[1], inside[1])


def seeds_for_certificate(sigma: float, response: Response, among: int = 1) -> int:
    """Seeds after which a design in the middle of its window could be certified on their mean alone."""
    lower, upper = response.window
    inside, near = WINDOW_PROBABILITY ** (1.0 / among), TOLERANCE_PROBABILITY
    from_window = 0.5 * (upper - lower) * float(_central_margins(inside)[0][-1])
    from_tolerance = response.tolerance * float(_central_margins(near)[0][-1])
    return math.ceil((sigma / float(min(from_window, from_tolerance))) ** 2)


def seeds_within_tolerance(sigma: float, response: Response) -> int:
    """Seeds whose mean alone lies within the tolerance of the truth with the certificate's chance."""
    z = float(ndtri(0.5 + 0.5 * TOLERANCE_PROBABILITY))
    return math.ceil((z * sigma / response.tolerance) ** 2)


class Course(NamedTuple):
    """One response of a certificate that is planned: m and s (k,) as now, its noise and inflation."""

    response: Response
    m: FloatArray
    s: FloatArray
    sigma: float
    lam: float


def certificate_chance(courses: Sequence[Course], r: int) -> FloatArray:
    """Chance that r further runs at a design leave its posterior good enough for the certificate.

    The posterior mean after r runs is, seen from now, N(m, s^2 - s_r^2); the responses are independent.
    """
    chance = np.ones(len(courses[0].m))
    for response, m, s, sigma, lam in courses:
        s_r = 1.0 / np.sqrt(1.0 / s**2 + r / sigma**2)
        move = lam * np.sqrt(np.maximum(s**2 - s_r**2, 1e-18))
        lower, upper = certifiable_means(lam * s_r, response, len(courses))
        reached = ndtr((upper - m) / move) - ndtr((lower - m) / move)
        chance = chance * np.where(upper > lower, reached, 0.0)
    return np.asarray(chance)


def effort(courses: Sequence[Course], missing: FloatArray, most: int) -> tuple[FloatArray, FloatArray]:
    """Simulations per certificate of the best plan "r runs here, then look": min over r of r / chance.

    missing (k,): seeds a design lacks for the certificate's count. most: runs left. Returns the effort (k,),
    infinite where no plan has a chance, and the best chance of any plan (k,).
    """
    best, highest = np.full(len(missing), np.inf), np.zeros(len(missing))
    for r in range(1, most + 1):
        chance = np.where(missing <= r, certificate_chance(courses, r), 0.0)
        highest = np.maximum(highest, chance)
        best = np.minimum(best, np.divide(r, chance, out=np.full_like(chance, np.inf), where=chance > 1e-12))
    return best, highest


def discrepancy_sd(response: Response) -> float:
    """A quarter of the window's width; see the notation."""
    lower, upper = response.window
    return 0.25 * (upper - lower)


def counting_sd(response: Response) -> float:
    """tau."""
    return math.hypot(response.uncertainty, discrepancy_sd(response))


@lru_cache(maxsize=8)
def _normals(responses: int) -> FloatArray:
    points = sobol(responses, NORMALS, STREAM_NORMALS)
    return np.asarray(ndtri(np.clip(points, 1e-9, 1.0 - 1e-9)))


def _chi(m: FloatArray, s: FloatArray, t: FloatArray, tau: FloatArray) -> FloatArray:
    """Samples of chi (Q, k) for m and s (responses, k)."""
    z = _normals(len(t))
    scaled = (m[None] + z[:, :, None] * s[None] - t[None, :, None]) / tau[None, :, None]
    return np.asarray(np.sqrt(np.sum(scaled**2, axis=1)))


def joint_miss(m: FloatArray, s: FloatArray, t: FloatArray, tau: FloatArray) -> FloatArray:
    """E chi (k,) over several responses, by the fixed normals; m, s (responses, k), t, tau (responses,)."""
    return np.asarray(np.mean(_chi(m, s, t, tau), axis=0))


def joint_improvement(m: FloatArray, s: FloatArray, t: FloatArray, tau: FloatArray, b: float) -> FloatArray:
    """E max(0, b - chi) (k,), by the fixed normals: the same for the same arguments."""
    return np.asarray(np.mean(np.maximum(b - _chi(m, s, t, tau), 0.0), axis=0))

"""The synthetic repose angle of calibration.md, on which strategies are ranked.

    angle = 14.5 + 9 S(pp/.2) + 18 S(r/.25) S(pp/.3) + 1.5 S(pw/.3) - 3 (e - .1)/.5 exp(-r/.3)    degrees
    S(a) = 1 - exp(-a)

pp and pw (friction between particles and against the wall) in .1 to .9, e (restitution) in .1 to .6, r
(rolling resistance) in .05 to .6; one run adds noise of sd .5 deg. Crash region: a run crashes with
probability `logistic((.435 - u_pp - u_r) / .03)`, u the unit-cube values: the corner of low friction and low
rolling, 10 % of the space.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import expit

from service.domain.observables import ANGLE
from service.domain.search_space import default_space
from service.domain.study import Response, StudySpec
from worker.optimizer.design import FloatArray, X

NOISE_SD_DEG = 0.5
CASES = {
    "coke": Response(ANGLE, 36.5, (35.0, 38.0), 0.5),
    "sinter": Response(ANGLE, 31.0, (29.0, 33.0), 0.5),
    "pellet": Response(ANGLE, 25.5, (25.0, 26.0), 0.5),
}

# Another test turns about this angle; see SyntheticRig.
PIVOT_DEG = 30.0


def _saturate(a: FloatArray) -> FloatArray:
    return np.asarray(1.0 - np.exp(-a))


def true_angle(x: FloatArray) -> FloatArray:
    """Noiseless angle, degrees, of designs x (k, 4): pp, pw, e, r as `default_space` orders them."""
    pp, pw, e, r = np.asarray(x, dtype=np.float64).T
    steep = 9.0 * _saturate(pp / 0.2) + 18.0 * _saturate(r / 0.25) * _saturate(pp / 0.3)
    return np.asarray(14.5 + steep + 1.5 * _saturate(pw / 0.3) - 3.0 * (e - 0.1) / 0.5 * np.exp(-r / 0.3))


def crash_probability(x: FloatArray) -> FloatArray:
    """Chance that a run at x (k, 4) ends in error."""
    pp, _, _, r = np.asarray(x, dtype=np.float64).T
    return np.asarray(expit((0.435 - (pp - 0.1) / 0.8 - (r - 0.05) / 0.55) / 0.03))


@dataclass(frozen=True)
class SyntheticRig:
    """Runs a design: a pure function of (x, seed), as the DEM is.

    `ratio`, `shift_deg` and `wave_deg` make it another test, whose angle is
    `30 + shift + ratio (angle - 30) + wave sin(6 u_r + 3 u_e)`.
    """

    noise_sd_deg: float = NOISE_SD_DEG
    ratio: float = 1.0
    shift_deg: float = 0.0
    wave_deg: float = 0.0

    def mean(self, x: FloatArray) -> FloatArray:
        """Noiseless angle of this rig at designs x (k, 4)."""
        _, _, e, r = np.asarray(x, dtype=np.float64).T
        wave = np.sin(6.0 * (r - 0.05) / 0.55 + 3.0 * (e - 0.1) / 0.5)
        angle = PIVOT_DEG + self.shift_deg + self.ratio * (true_angle(x) - PIVOT_DEG) + self.wave_deg * wave
        return np.asarray(angle)

    def run(self, x: X, seed: int) -> dict[str, float] | None:
        """Results by observable; None after a crash."""
        stream = np.random.default_rng(np.random.SeedSequence([seed, *(round(v * 1e6) for v in x)]))
        point = np.array([x])
        if stream.random() < float(crash_probability(point)[0]):
            return None
        return {ANGLE: float(self.mean(point)[0]) + self.noise_sd_deg * float(stream.normal())}


# At the coarse scale: steeper, higher by 1.5 deg, and 0.5 deg of its own shape.
COARSE_RIG = SyntheticRig(ratio=1.06, shift_deg=1.5, wave_deg=0.5)
# The rig of an earlier study: another batch of the material.
EARLIER_RIG = SyntheticRig(ratio=0.95, shift_deg=-1.0, wave_deg=0.5)
COARSE_SCALE = 2.0


def study(case: str, seed: int, budget: int = 40, parallel: int = 1, **changes: Any) -> StudySpec:
    """The study of one case over the paper's default space."""
    if not math.isfinite(budget) or case not in CASES:
        raise ValueError(f"case {case!r} is not one of {', '.join(CASES)}")
    given = {"budget": budget, "parallel": parallel, "seed": seed, **changes}
    return StudySpec(case, 1.0, default_space(), (CASES[case],), **given)

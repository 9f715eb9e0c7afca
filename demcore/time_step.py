"""The largest stable time step of the hysteretic spring. Source: physics.md section 1.

dt = (pi/2) sqrt(m*/K_l) min(1/N_l, e/N_u), over the stiffest, lightest pair; N_l = 15 steps to load, N_u = 8 to
unload. The preset `fast` keeps the loading limit only: twice as fast, under 0.01 in e.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.errors import InputError

LOADING_STEPS = 15.0
UNLOADING_STEPS = 8.0
PRESETS = ("fast", "paper")
# Share of the Rayleigh time that a step may take with Hertz-Mindlin.
RAYLEIGH_SHARE = 0.2
# Unlike materials: the stiffest, lightest pair may lie inside the size ranges.
SAMPLED_DIAMETERS = 33


def loading_time(mass: float, stiffness: float) -> float:
    """(pi/2) sqrt(m*/K_l), s: from first touch to largest overlap."""
    return 0.5 * math.pi * math.sqrt(mass / stiffness)


def time_step(
    smallest_diameter: float, density: float, youngs_modulus: float, restitution: float, preset: str = "fast"
) -> float:
    """Time step, s, for spheres of one density (kg/m3) and Young's modulus (Pa).

    The lightest pair is two of the smallest spheres: m* = m/2 and K_l = E d/2; dt falls with d.
    Raises InputError for an unknown preset.
    """
    if preset not in PRESETS:
        raise InputError("time_step", preset, " or ".join(PRESETS))
    mass = density * math.pi / 6.0 * smallest_diameter**3
    share = steps_share(restitution, preset)
    return loading_time(mass / 2.0, youngs_modulus * smallest_diameter / 2.0) * share


def hertz_time_step(
    smallest_diameter: float,
    density: float,
    youngs_modulus: float,
    poisson_ratio: float,
    share: float = RAYLEIGH_SHARE,
) -> float:
    """A share of the Rayleigh time pi r sqrt(rho/G) / (0.1631 nu + 0.8766), s (Hertz-Mindlin)."""
    shear = youngs_modulus / (2.0 * (1.0 + poisson_ratio))
    rayleigh = math.pi * smallest_diameter / 2.0 * math.sqrt(density / shear)
    return share * rayleigh / (0.1631 * poisson_ratio + 0.8766)


class Body(NamedTuple):
    """A granular material as the time step sees it: smallest and largest diameter (m), density (kg/m3), Young's
    modulus (Pa), Poisson ratio."""

    smallest: float
    largest: float
    density: float
    youngs_modulus: float
    poisson_ratio: float

    def diameters(self) -> NDArray[np.float64]:
        """Diameters (K,), m, that stand for the range; of equal materials the smallest pair decides."""
        return np.geomspace(self.smallest, self.largest, SAMPLED_DIAMETERS)


def steps_share(restitution: float, preset: str) -> float:
    """min(1/N_l, e/N_u) of the loading time, or the first alone with the preset `fast`."""
    share = 1.0 / LOADING_STEPS
    return share if preset == "fast" else min(share, restitution / UNLOADING_STEPS)


def pair_time_step(a: Body, b: Body, restitution: float, preset: str) -> float:
    """Largest time step, s, over all sizes of two materials (physics.md section 1)."""
    d_a, d_b = a.diameters()[:, None], b.diameters()[None, :]
    m_a = a.density * math.pi / 6.0 * d_a**3
    m_b = b.density * math.pi / 6.0 * d_b**3
    softness = 1.0 / (a.youngs_modulus * d_a) + 1.0 / (b.youngs_modulus * d_b)
    shortest = float((m_a * m_b / (m_a + m_b) * softness).min())
    return 0.5 * math.pi * math.sqrt(shortest) * steps_share(restitution, preset)


def wall_time_step(a: Body, wall_modulus: float, restitution: float, preset: str) -> float:
    """Largest time step, s, at a wall of that Young's modulus (Pa): m* = m, its stiffness E_wall d."""
    d = a.smallest
    mass = a.density * math.pi / 6.0 * d**3
    softness = (1.0 / a.youngs_modulus + 1.0 / wall_modulus) / d
    return 0.5 * math.pi * math.sqrt(mass * softness) * steps_share(restitution, preset)

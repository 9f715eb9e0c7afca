"""The largest stable time step of the hysteretic spring. Source: physics.md section 1.

dt = (pi/2) sqrt(m*/K_l) min(1/N_l, e/N_u), over the stiffest, lightest pair; N_l = 15 steps to load, N_u = 8 to
unload. The preset `fast` keeps the loading limit only: twice as fast, under 0.01 in e.
"""

from __future__ import annotations

import math

from demcore.errors import InputError

LOADING_STEPS = 15.0
UNLOADING_STEPS = 8.0
PRESETS = ("fast", "paper")


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
    share = 1.0 / LOADING_STEPS
    if preset == "paper":
        share = min(share, restitution / UNLOADING_STEPS)
    return loading_time(mass / 2.0, youngs_modulus * smallest_diameter / 2.0) * share


def hertz_time_step(
    smallest_diameter: float, density: float, youngs_modulus: float, poisson_ratio: float, share: float = 0.2
) -> float:
    """A share of the Rayleigh time pi r sqrt(rho/G) / (0.1631 nu + 0.8766), s (Hertz-Mindlin)."""
    shear = youngs_modulus / (2.0 * (1.0 + poisson_ratio))
    rayleigh = math.pi * smallest_diameter / 2.0 * math.sqrt(density / shear)
    return share * rayleigh / (0.1631 * poisson_ratio + 0.8766)

"""Hertz normal law with the damping that gives a constant restitution (Tsuji, Tanaka and Ishida 1992).

Source: Chung and Ooi 2011 benchmarks; damping ratio of LIGGGHTS' `gran model hertz`.

R, E  effective radius (m) and modulus E* (Pa)       S_n = 2 E sqrt(R s)   tangent stiffness, N/m
beta  damping ratio -ln e / sqrt(ln^2 e + pi^2)      F = 4/3 E sqrt(R s) s - 2 sqrt(5/6) beta sqrt(S_n m) v_n
"""

from __future__ import annotations

import math
from typing import NamedTuple

from demcore.contact.model import Normal, Pair
from demcore.jit import leaf

ROOT_FIVE_SIXTHS = 0.9128709291752769


class Hertz(NamedTuple):
    """`clamp` 1.0: the damped force is never attractive (LIGGGHTS: limitForce on); 0.0: it may be, as Tsuji's."""

    clamp: float = 0.0


@leaf
def hertz_normal(
    law: Hertz,
    pair: Pair,
    overlap: float,
    speed: float,
    elastic_before: float,
    overlap_before: float,
    age: float,
    dt: float,
) -> Normal:
    """Normal force; `speed` is the separation speed v_n, m/s (positive: opening)."""
    root = math.sqrt(pair.radius * overlap)
    stiffness = 2.0 * pair.youngs * root
    elastic = stiffness * overlap * (2.0 / 3.0)
    shear = 8.0 * pair.shear * root
    viscous = 2.0 * ROOT_FIVE_SIXTHS * pair.damping_ratio
    force = elastic - viscous * math.sqrt(stiffness * pair.mass) * speed
    force = max(force, 0.0) if law.clamp > 0.0 else force
    damping = viscous * math.sqrt(shear * pair.mass)
    return Normal(force, elastic, shear, damping, age + dt)

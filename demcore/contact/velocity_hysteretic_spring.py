"""Hysteretic linear spring whose restitution falls with the impact speed, e(v) = e0 (v / v0)^-p.

Source: the unloading of Walton and Braun 1986, whose stiffness depends on the largest force that a contact has
seen; the power of the speed is Johnson's (Contact Mechanics 1985, section 11.5, p = 1/4 for full plasticity).

s     overlap, m                                     K_l   loading stiffness, N/m
F_m   largest elastic force of the contact, N; what the law remembers in place of the last force
v     impact speed that F_m tells: F_m = v sqrt(m K_l) where loading began apart, m/s
K_u   unloading stiffness K_l / e(v)^2; F = F_m - K_u (F_m / K_l - s) while that is below K_l s
lam, zeta, aged contacts: as in hysteretic_spring.py

Pressed again, a contact comes back along its own line, so nothing is gained on any path.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from demcore.contact.model import Normal, Pair
from demcore.jit import leaf

HALF_PI = 1.5707963267948966
# Restitution is kept inside what contacts allow (interaction.Interaction).
LEAST_RESTITUTION = 0.05


class VelocityHystereticSpring(NamedTuple):
    """Numerics as HystereticLinearSpring's; `exponent` p, and the speed v0, m/s, at which a pair's e holds."""

    residual: float = 0.001
    damping: float = 0.5
    aged_after: float = 3.0
    exponent: float = 0.25
    reference_speed: float = 1.0


@leaf
def velocity_hysteretic_normal(
    law: VelocityHystereticSpring,
    pair: Pair,
    overlap: float,
    speed: float,
    elastic_before: float,
    overlap_before: float,
    age: float,
    dt: float,
) -> Normal:
    """Normal force; `speed` is the separation speed v_n, m/s (positive: opening)."""
    k_l = pair.stiffness
    loaded = k_l * overlap
    largest = max(elastic_before, loaded)
    impact = largest / math.sqrt(pair.mass * k_l)
    # Where loading has only begun, impact is 0 and the power is not wanted.
    slowed = (impact / law.reference_speed) ** -law.exponent if impact > 0.0 else 1.0
    restitution = min(max(pair.restitution * slowed, LEAST_RESTITUTION), 1.0)
    line = largest - (largest - loaded) / (restitution * restitution)
    floor = law.residual * loaded
    elastic = max(line, floor)
    age += dt
    limit = law.aged_after * HALF_PI
    aged = age * age * k_l > limit * limit * pair.mass
    parting = overlap < overlap_before and line <= floor
    damping = 2.0 * law.damping * math.sqrt(pair.mass * k_l) if aged and not parting else 0.0
    force = max(elastic - damping * speed, 0.0)
    return Normal(force, largest, k_l, damping, age)

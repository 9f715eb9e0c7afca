"""Linear spring with a Coulomb limit, static and dynamic friction (the paper's "Linear Spring Coulomb Limit").

Source: physics.md section 1. `F_t` is stored, turned into the new tangent plane, and grows by K_t v_t dt.
The turn drops the normal part of F_t: the loss is of second order in the angle of one step (1e-4), so over a
whole turn it vanishes with dt.
"""

from __future__ import annotations

from typing import NamedTuple

from demcore.contact.cap import limited_friction
from demcore.contact.model import Normal, Pair, Tangential, Vec3
from demcore.jit import leaf


class CoulombSpring(NamedTuple):
    """`stiffness_ratio` r_K = K_t / K_l; below `creep_speed` (m/s) a capped contact counts as sticking."""

    stiffness_ratio: float = 1.0
    creep_speed: float = 1e-3


@leaf
def coulomb_spring(
    law: CoulombSpring,
    pair: Pair,
    normal: Normal,
    n: Vec3,
    velocity: Vec3,
    spring: Vec3,
    sliding: float,
    dt: float,
) -> Tangential:
    """Tangential force on body i; `velocity` is the relative velocity in the tangent plane, m/s."""
    stiffness = law.stiffness_ratio * normal.stiffness
    along = spring.x * n.x + spring.y * n.y + spring.z * n.z
    step = stiffness * dt
    x = spring.x - along * n.x - step * velocity.x
    y = spring.y - along * n.y - step * velocity.y
    z = spring.z - along * n.z - step * velocity.z
    friction = limited_friction(pair, normal, Vec3(x, y, z), velocity, sliding, law.creep_speed)
    kept = friction.kept
    return Tangential(friction.force, Vec3(x * kept, y * kept, z * kept), friction.slides, stiffness)

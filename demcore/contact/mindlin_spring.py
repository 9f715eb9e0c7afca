"""Mindlin's tangential spring with history and a Coulomb limit: F_t = K_t(s) xi, xi the slip that is stored.

Source: Mindlin 1949 without partial slip; what Chung and Ooi 2011 compare (their test 4) and what LIGGGHTS'
`tangential history` does. K_t = 8 G sqrt(R s) comes with the Hertz law and changes with the overlap: it is the
displacement that a contact remembers, not the force. A force that is remembered instead (CoulombSpring) misses
the published test 4 below 15 degrees. Like every law of this kind it is no potential: pressing a contact that is
held sheared stiffens the shear for nothing (Elata and Berryman 1996); at a constant overlap it only dissipates.
"""

from __future__ import annotations

from typing import NamedTuple

from demcore.contact.cap import limited_friction
from demcore.contact.model import Normal, Pair, Tangential, Vec3
from demcore.jit import leaf


class MindlinSpring(NamedTuple):
    """Below `creep_speed` (m/s) a capped contact counts as sticking: static, not dynamic friction."""

    creep_speed: float = 1e-3


@leaf
def mindlin_spring(
    law: MindlinSpring,
    pair: Pair,
    normal: Normal,
    n: Vec3,
    velocity: Vec3,
    spring: Vec3,
    sliding: float,
    dt: float,
) -> Tangential:
    """Tangential force on body i; `velocity` is the relative velocity in the tangent plane, m/s; `spring` is the
    stored displacement, m, and its sign is the force's."""
    stiffness = normal.stiffness
    along = spring.x * n.x + spring.y * n.y + spring.z * n.z
    x = spring.x - along * n.x - velocity.x * dt
    y = spring.y - along * n.y - velocity.y * dt
    z = spring.z - along * n.z - velocity.z * dt
    force = Vec3(stiffness * x, stiffness * y, stiffness * z)
    friction = limited_friction(pair, normal, force, velocity, sliding, law.creep_speed)
    kept = friction.kept
    return Tangential(friction.force, Vec3(x * kept, y * kept, z * kept), friction.slides, stiffness)

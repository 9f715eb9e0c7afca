"""Elastic-plastic rolling resistance without dashpot: Rocky's "type 3", LIGGGHTS' epsd2.

Source: physics.md section 1; Ai, Chen, Rotter and Ooi 2011, model C. K_r = R_r^2 K_t; |M| <= mu_r R_r F_n.
"""

from __future__ import annotations

from typing import NamedTuple

from demcore.contact.cap import cap_share
from demcore.contact.model import Normal, Pair, Vec3
from demcore.jit import leaf


class Type3Rolling(NamedTuple):
    """No numerics of its own; `enabled` 0.0 switches rolling resistance off."""

    enabled: float = 1.0


@leaf
def type3_rolling(
    law: Type3Rolling,
    pair: Pair,
    normal: Normal,
    tangential_stiffness: float,
    n: Vec3,
    spin: Vec3,
    couple: Vec3,
    dt: float,
) -> Vec3:
    """Rolling couple on body i, N m; `spin` is the relative angular velocity, rad/s."""
    twist = spin.x * n.x + spin.y * n.y + spin.z * n.z
    along = couple.x * n.x + couple.y * n.y + couple.z * n.z
    step = law.enabled * pair.radius * pair.radius * tangential_stiffness * dt
    x = couple.x - along * n.x - step * (spin.x - twist * n.x)
    y = couple.y - along * n.y - step * (spin.y - twist * n.y)
    z = couple.z - along * n.z - step * (spin.z - twist * n.z)
    limit = pair.rolling * pair.radius * max(normal.force, 0.0)
    share = cap_share(x, y, z, limit)
    return Vec3(x * share, y * share, z * share)

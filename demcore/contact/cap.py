"""Limits of friction and rolling resistance: a vector may not exceed a length, and what Coulomb makes of it."""

from __future__ import annotations

import math
from typing import NamedTuple

from demcore.contact.model import Normal, Pair, Vec3
from demcore.jit import leaf


@leaf
def cap_share(x: float, y: float, z: float, limit: float) -> float:
    """The factor, at most 1, that brings (x, y, z) down to the length `limit`; without a branch around it."""
    squared = x * x + y * y + z * z
    if squared > limit * limit:
        return limit / math.sqrt(squared)
    return 1.0


class Friction(NamedTuple):
    """force: on body i, N; kept: share of the spring that is left; slides: 1.0 while slipping at speed, or 0.0."""

    force: Vec3
    kept: float
    slides: float


@leaf
def limited_friction(
    pair: Pair, normal: Normal, spring: Vec3, velocity: Vec3, sliding: float, creep_speed: float
) -> Friction:
    """Coulomb's limit on a spring's force (N), with the dashpot beside the spring while it holds.

    A contact that slid at the last step has dynamic friction. Spring and dashpot together still obey Coulomb; one
    cap serves both cases, because roots are the dear part of a contact.
    """
    limit = (pair.dynamic if sliding > 0.0 else pair.static) * max(normal.force, 0.0)
    capped = spring.x * spring.x + spring.y * spring.y + spring.z * spring.z > limit * limit
    c = 0.0 if capped else normal.damping
    x = spring.x - c * velocity.x
    y = spring.y - c * velocity.y
    z = spring.z - c * velocity.z
    share = cap_share(x, y, z, limit)
    speed = velocity.x * velocity.x + velocity.y * velocity.y + velocity.z * velocity.z
    slides = 1.0 if capped and speed > creep_speed * creep_speed else 0.0
    return Friction(Vec3(x * share, y * share, z * share), share if capped else 1.0, slides)

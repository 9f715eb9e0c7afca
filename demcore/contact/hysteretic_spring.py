"""Hysteretic linear spring (Walton and Braun 1986, incremental form) with damping of aged contacts.

Source: physics.md section 1; the paper names it "Hysteretic Linear Spring model".

s     overlap, m; ds its change in the step          K_l   loading stiffness, N/m: E L of both sides in series
K_u   unloading stiffness K_l / e^2                  F     elastic force, N
lam   share of K_l s below which unloading never falls (keeps a residual pull-off from being adhesive)
zeta  long-term damping coefficient; a contact is aged after n loading times (pi/2) sqrt(m/K_l)
"""

from __future__ import annotations

import math
from typing import NamedTuple

from demcore.contact.model import Normal, Pair
from demcore.jit import leaf

HALF_PI = 1.5707963267948966


class HystereticLinearSpring(NamedTuple):
    """Numerics of the law. The damping's formula is public nowhere; ours is a choice, recorded with a run."""

    residual: float = 0.001
    damping: float = 0.5
    aged_after: float = 3.0


@leaf
def hysteretic_normal(
    law: HystereticLinearSpring,
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
    k_u = k_l * pair.unloading
    change = overlap - overlap_before
    moved = elastic_before + k_u * change
    floor = law.residual * k_l * overlap
    elastic = min(k_l * overlap, moved) if change >= 0.0 else max(moved, floor)
    age += dt
    # age > n (pi/2) sqrt(m/K), squared.
    limit = law.aged_after * HALF_PI
    aged = age * age * k_l > limit * limit * pair.mass
    # On the floor of the unloading branch the bodies are parting: a slow impact (small e) is old by then, and
    # damping it would alter its restitution.
    parting = change < 0.0 and moved <= floor
    damping = 2.0 * law.damping * math.sqrt(pair.mass * k_l) if aged and not parting else 0.0
    # The elastic part is never negative, so without damping this is the elastic part itself.
    force = max(elastic - damping * speed, 0.0)
    return Normal(force, elastic, k_l, damping, age)

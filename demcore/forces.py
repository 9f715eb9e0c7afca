"""The one loop over pairs of particles: a slab at a time, accumulated without races.

Notation: n unit normal from body j to body i; s overlap; v relative velocity of the surfaces at the contact
(i minus j); arm distance of a centre to the contact plane. Force F acts on i at the contact.

Why slabs: particles are sorted along one axis into slabs that are thicker than any contact is long, and a pair
is owned by its particle of lower index. The pairs of a slab then write to that slab and the next one only, and
they write to the next one in columns of their own. So all slabs can run at once, or one after another, and
every sum is made in the same order. No force is computed twice.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.contact.model import ContactModel, Vec3
from demcore.jit import kernel
from demcore.particles import HANDED, Floats, Particles
from demcore.wrench import (
    Tables,
    contact_wrench,
    forget,
    recall,
    remember,
    series_stiffness,
    touching_pair,
)


class Neighbours(NamedTuple):
    """Half list by owner: partners of particle i are partner[start[i]:start[i + 1]], history alongside.

    slab_start (S + 1,) are the first particles of the slabs.
    """

    start: NDArray[np.int64]
    partner: NDArray[np.int32]
    history: Floats
    slab_start: NDArray[np.int64]


@kernel
def slab_forces(
    first: int,
    last: int,
    particles: Particles,
    neighbours: Neighbours,
    model: ContactModel,
    tables: Tables,
    dt: float,
) -> None:
    """Add the forces of all pairs owned by particles first to last - 1, which are a whole slab."""
    state, force, kinds = particles.state, particles.force, particles.material
    history = neighbours.history
    for i in range(first, last):
        x, y, z, r = state[i, 0], state[i, 1], state[i, 2], state[i, 3]
        vx, vy, vz, m = state[i, 4], state[i, 5], state[i, 6], state[i, 7]
        wx, wy, wz = state[i, 8], state[i, 9], state[i, 10]
        a = kinds[i]
        fx = fy = fz = tx = ty = tz = 0.0
        for k in range(neighbours.start[i], neighbours.start[i + 1]):
            j = neighbours.partner[k]
            dx, dy, dz = x - state[j, 0], y - state[j, 1], z - state[j, 2]
            reach = r + state[j, 3]
            squared = dx * dx + dy * dy + dz * dz
            if squared >= reach * reach:
                if history[k, 1] != 0.0:
                    forget(history, k)
                continue
            d = math.sqrt(squared)
            inverse = 1.0 / d
            n = Vec3(dx * inverse, dy * inverse, dz * inverse)
            s = reach - d
            rj, mj, b = state[j, 3], state[j, 7], kinds[j]
            arm_i, arm_j = r - 0.5 * s, rj - 0.5 * s
            # Surface velocity: spins act through the arms, (arm_i w_i + arm_j w_j) x n.
            ux = arm_i * wx + arm_j * state[j, 8]
            uy = arm_i * wy + arm_j * state[j, 9]
            uz = arm_i * wz + arm_j * state[j, 10]
            v = Vec3(
                vx - state[j, 4] - (uy * n.z - uz * n.y),
                vy - state[j, 5] - (uz * n.x - ux * n.z),
                vz - state[j, 6] - (ux * n.y - uy * n.x),
            )
            stiffness = series_stiffness(tables.youngs[a], tables.youngs[b], 2.0 * r, 2.0 * rj)
            pair = touching_pair(tables, a, b, stiffness, m * mj / (m + mj), r * rj / reach)
            spin = Vec3(wx - state[j, 8], wy - state[j, 9], wz - state[j, 10])
            wrench = contact_wrench(model, pair, s, n, v, spin, recall(history, k), dt)
            remember(history, k, wrench.history)
            f, ft, couple = wrench.force, wrench.tangential, wrench.couple
            # Torque of F_t about each centre: -arm n x F_t on both sides.
            cx = n.y * ft.z - n.z * ft.y
            cy = n.z * ft.x - n.x * ft.z
            cz = n.x * ft.y - n.y * ft.x
            fx += f.x
            fy += f.y
            fz += f.z
            tx += couple.x - arm_i * cx
            ty += couple.y - arm_i * cy
            tz += couple.z - arm_i * cz
            c = HANDED if j >= last else 0
            force[j, c] -= f.x
            force[j, c + 1] -= f.y
            force[j, c + 2] -= f.z
            force[j, c + 3] -= couple.x + arm_j * cx
            force[j, c + 4] -= couple.y + arm_j * cy
            force[j, c + 5] -= couple.z + arm_j * cz
        force[i, 0] += fx
        force[i, 1] += fy
        force[i, 2] += fz
        force[i, 3] += tx
        force[i, 4] += ty
        force[i, 5] += tz

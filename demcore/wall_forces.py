"""The one loop over contacts with walls, a slab of particles at a time, after the slab's pairs.

Notation: n unit normal from the wall to the particle; d distance of the centre to the wall, which is the arm.
A wall contact writes to its own particle only, so slabs need no order among themselves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.contact.model import ContactModel, Vec3
from demcore.geometry.walls import Walls, wall_distance, wall_velocity
from demcore.jit import kernel
from demcore.particles import Floats, Particles
from demcore.wrench import (
    OVERLAP,
    Tables,
    contact_wrench,
    forget,
    recall,
    remember,
    series_stiffness,
    touching_pair,
)


class WallList(NamedTuple):
    """Walls within reach, for the few particles that have any: owner (P,) are their rows, ascending; those of
    owner[p] are wall[start[p]:start[p + 1]], history alongside."""

    owner: NDArray[np.int64]
    start: NDArray[np.int64]
    wall: NDArray[np.int32]
    history: Floats


@kernel
def wall_forces(
    first: int,
    last: int,
    particles: Particles,
    walls: Walls,
    near: WallList,
    model: ContactModel,
    tables: Tables,
    dt: float,
) -> None:
    """Add the forces of all wall contacts of particles first to last - 1."""
    state, force, history = particles.state, particles.force, near.history
    for p in range(np.searchsorted(near.owner, first), np.searchsorted(near.owner, last)):
        i = near.owner[p]
        x, y, z, r = state[i, 0], state[i, 1], state[i, 2], state[i, 3]
        vx, vy, vz, m = state[i, 4], state[i, 5], state[i, 6], state[i, 7]
        wx, wy, wz = state[i, 8], state[i, 9], state[i, 10]
        a = particles.material[i]
        for k in range(near.start[p], near.start[p + 1]):
            w = near.wall[k]
            d, n = wall_distance(walls.kind[w], walls.data, w, x, y, z)
            if d >= r:
                if history[k, OVERLAP] != 0.0:
                    forget(history, k)
                continue
            surface = wall_velocity(walls.data, w, x - d * n.x, y - d * n.y, z - d * n.z)
            v = Vec3(
                vx - surface.x - d * (wy * n.z - wz * n.y),
                vy - surface.y - d * (wz * n.x - wx * n.z),
                vz - surface.z - d * (wx * n.y - wy * n.x),
            )
            b = int(walls.data[w, 17])
            stiffness = series_stiffness(tables.youngs[a], tables.youngs[b], 2.0 * r, 2.0 * r)
            pair = touching_pair(tables, a, b, stiffness, m, r)
            spin = Vec3(wx - walls.data[w, 11], wy - walls.data[w, 12], wz - walls.data[w, 13])
            wrench = contact_wrench(model, pair, r - d, n, v, spin, recall(history, k), dt)
            remember(history, k, wrench.history)
            f, ft, couple = wrench.force, wrench.tangential, wrench.couple
            force[i, 0] += f.x
            force[i, 1] += f.y
            force[i, 2] += f.z
            force[i, 3] += couple.x - d * (n.y * ft.z - n.z * ft.y)
            force[i, 4] += couple.y - d * (n.z * ft.x - n.x * ft.z)
            force[i, 5] += couple.z - d * (n.x * ft.y - n.y * ft.x)

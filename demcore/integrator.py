"""Time integration: semi-implicit Euler (velocities live half a step behind), serial or threaded, same bits.

v += (F/m + g) dt;  x += v dt;  w += T/I dt; F and T hold contacts and the field law (drag of air).
`moved` is (skin/2)^2, m2: beyond it the neighbour list is stale.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from demcore.contact.laws import field_wrench
from demcore.contact.model import Body, ContactModel, Vec3
from demcore.forces import Neighbours, slab_forces
from demcore.geometry.walls import Walls
from demcore.jit import kernel, leaf, parallel_kernel, prange
from demcore.particles import HANDED, Floats, Particles
from demcore.wall_forces import WallList, wall_forces
from demcore.wrench import Tables


@leaf
def body(state: Floats, i: int) -> Body:
    """Particle i as a field law sees it."""
    return Body(
        Vec3(state[i, 0], state[i, 1], state[i, 2]),
        Vec3(state[i, 4], state[i, 5], state[i, 6]),
        Vec3(state[i, 8], state[i, 9], state[i, 10]),
        state[i, 3],
        state[i, 7],
    )


@kernel
def move(
    first: int, last: int, particles: Particles, field: Any, gravity: Floats, dt: float, moved: float
) -> bool:
    """Move particles first to last - 1 by one step; True when one of them left its neighbours' knowledge.

    A position that is not finite also says True, so that the search, which checks, is reached at once.
    """
    state, force, home = particles.state, particles.force, particles.home
    stale = False
    for i in range(first, last):
        by_mass = dt / state[i, 7]
        by_inertia = dt / state[i, 11]
        squared = 0.0
        push = field_wrench(field, body(state, i))
        for c in range(3):
            f, t = push.force[c], push.torque[c]
            state[i, 4 + c] += (force[i, c] + force[i, HANDED + c] + f) * by_mass + gravity[c] * dt
            state[i, 8 + c] += (force[i, 3 + c] + force[i, HANDED + 3 + c] + t) * by_inertia
            state[i, c] += state[i, 4 + c] * dt
            away = state[i, c] - home[i, c]
            squared += away * away
        force[i] = 0.0
        if not squared <= moved:
            stale = True
    return stale


@kernel
def move_walls(walls: Walls, dt: float) -> float:
    """Carry travelling walls by one step; the longest way one of them went, m."""
    longest = 0.0
    for w in range(len(walls.kind)):
        squared = 0.0
        for c in range(3):
            step = walls.data[w, 8 + c] * dt
            walls.data[w, c] += step
            squared += step * step
        longest = max(longest, math.sqrt(squared))
    return longest


@kernel
def advance_serial(
    steps: int,
    particles: Particles,
    neighbours: Neighbours,
    walls: Walls,
    near: WallList,
    normal: Any,
    tangential: Any,
    rolling: Any,
    cohesion: Any,
    field: Any,
    tables: Tables,
    gravity: Floats,
    dt: float,
    skin: float,
    wall_way: NDArray[np.float64],
) -> tuple[int, bool]:
    """Up to `steps` steps, fewer when the neighbour list goes stale; returns how many, and whether it did.

    `wall_way` (1,) is how far walls went since the last search, m; half the skin is theirs and the other half
    the particles'. The laws come one by one because a threaded loop takes no nested tuples.
    """
    model = ContactModel(normal, tangential, rolling, cohesion, field)
    slabs = neighbours.slab_start
    moved = 0.25 * skin * skin
    for step in range(steps):
        stale = False
        # One sweep while a slab is in the cache: once its own pairs are done nothing needs its old positions.
        for k in range(len(slabs) - 1):
            a, b = slabs[k], slabs[k + 1]
            slab_forces(a, b, particles, neighbours, model, tables, dt)
            wall_forces(a, b, particles, walls, near, model, tables, dt)
            stale = move(a, b, particles, field, gravity, dt, moved) or stale
        wall_way[0] += move_walls(walls, dt)
        if stale or wall_way[0] > 0.5 * skin:
            return step + 1, True
    return steps, False


@parallel_kernel
def advance_threaded(
    steps: int,
    particles: Particles,
    neighbours: Neighbours,
    walls: Walls,
    near: WallList,
    normal: Any,
    tangential: Any,
    rolling: Any,
    cohesion: Any,
    field: Any,
    tables: Tables,
    gravity: Floats,
    dt: float,
    skin: float,
    wall_way: NDArray[np.float64],
) -> tuple[int, bool]:
    """`advance_serial` with the slabs on all threads; the same bits."""
    slabs = neighbours.slab_start
    count = len(slabs) - 1
    moved = 0.25 * skin * skin
    gone = np.zeros(count, np.bool_)
    for step in range(steps):
        for k in prange(count):
            model = ContactModel(normal, tangential, rolling, cohesion, field)
            a, b = slabs[k], slabs[k + 1]
            slab_forces(a, b, particles, neighbours, model, tables, dt)
            wall_forces(a, b, particles, walls, near, model, tables, dt)
        for k in prange(count):
            gone[k] = move(slabs[k], slabs[k + 1], particles, field, gravity, dt, moved)
        wall_way[0] += move_walls(walls, dt)
        if np.any(gone) or wall_way[0] > 0.5 * skin:
            return step + 1, True
    return steps, False

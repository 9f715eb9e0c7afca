"""Time integration: semi-implicit Euler (velocities live half a step behind), serial or threaded, same bits.

v += (F/m + g) dt;  x += v dt;  w += T/I dt; F and T hold contacts and the field law (drag of air).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from demcore.contact.laws import field_wrench
from demcore.contact.model import Body, ContactModel, FieldWrench, Vec3
from demcore.dormant import AWAKE, DORMANT, FALLING, FORCE, FORCE_LOAD, SPEED, WAKE, WAKE_LOAD, Dormant
from demcore.forces import Neighbours, slab_forces
from demcore.geometry.motion import place_walls
from demcore.geometry.wall_rows import Walls
from demcore.jit import kernel, leaf, parallel_kernel, prange
from demcore.particles import Floats, Particles
from demcore.shares import share_slabs
from demcore.wall_forces import wall_forces
from demcore.wall_list import WallList
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
    first: int, last: int, particles: Particles, home: Floats, field: Any, gravity: Floats, dt: float
) -> tuple[float, bool]:
    """Move particles first to last - 1 by one step; the longest way one of them went, m (NaN: not finite), and
    whether one is farther from home than its pairs are known."""
    state, force = particles.state, particles.force
    fastest = 0.0
    finite = True
    strayed = False
    for i in range(first, last):
        by_mass = dt / state[i, 7]
        by_inertia = dt / state[i, 11]
        squared = away = 0.0
        push = field_wrench(field, body(state, i))
        for c in range(3):
            state[i, 4 + c] += (force[i, c] + push.force[c]) * by_mass + gravity[c] * dt
            state[i, 8 + c] += (force[i, 3 + c] + push.torque[c]) * by_inertia
            state[i, c] += state[i, 4 + c] * dt
            squared += state[i, 4 + c] * state[i, 4 + c]
            away += (state[i, c] - home[i, c]) * (state[i, c] - home[i, c])
            force[i, c] = 0.0
            force[i, 3 + c] = 0.0
        fastest = max(fastest, squared)
        strayed = strayed or not away <= home[i, 3]
        # Only NaN differs from itself.
        finite = finite and squared == squared
    return math.sqrt(fastest) * dt if finite else np.nan, strayed


@leaf
def hold(i: int, particles: Particles, dormant: Dormant, push: FieldWrench, gravity: Floats) -> bool:
    """Judge particle i, which is held: False when the force on it, which is forgotten, wakes it."""
    force, frozen, held = particles.force, dormant.frozen, dormant.held
    r, m = particles.state[i, 3], particles.state[i, 7]
    falling = dormant.state[i] == FALLING
    pulled = twisted = 0.0
    for c in range(3):
        f, t = force[i, c] + frozen[i, c], force[i, 3 + c] + frozen[i, 3 + c]
        if falling:
            held[i, c], held[i, 3 + c] = f, t
            f, t = f + push.force[c] + m * gravity[c], t + push.torque[c]
        else:
            f, t = f - held[i, c], t - held[i, 3 + c]
        pulled, twisted = pulled + f * f, twisted + t * t
        force[i, c], force[i, 3 + c] = 0.0, 0.0
    of_mass, of_load = (FORCE, FORCE_LOAD) if falling else (WAKE, WAKE_LOAD)
    limit = max(dormant.limits[of_mass] * m, dormant.limits[of_load] * dormant.load[i])
    # Not finite is not calm.
    return bool(pulled <= limit * limit and twisted <= limit * limit * r * r)


@kernel
def move_watched(
    slab: int,
    particles: Particles,
    lists: Neighbours,
    dormant: Dormant,
    field: Any,
    gravity: Floats,
    dt: float,
) -> tuple[float, bool]:
    """`move` for a slab of a run with dormancy: who is awake moves, and is watched for calm; who is not is held,
    and judged. One that wakes moves from the next step on, when all of its contacts are computed again."""
    state, force, home = particles.state, particles.force, lists.home
    mode, calm = dormant.state, dormant.calm
    slowest, least, share = dormant.limits[SPEED], dormant.limits[FORCE] * dt, dormant.limits[FORCE_LOAD]
    load = dormant.load
    fastest = 0.0
    finite = True
    strayed = False
    woke = 0
    for i in range(lists.slab_start[slab], lists.slab_start[slab + 1]):
        push = field_wrench(field, body(state, i))
        if mode[i] != AWAKE:
            if hold(i, particles, dormant, push, gravity):
                mode[i] = DORMANT
            else:
                mode[i], calm[i] = AWAKE, 0
                woke += 1
            continue
        by_mass = dt / state[i, 7]
        by_inertia = dt / state[i, 11]
        squared = spun = pulled = twisted = away = 0.0
        for c in range(3):
            gain = (force[i, c] + push.force[c]) * by_mass + gravity[c] * dt
            turn = (force[i, 3 + c] + push.torque[c]) * by_inertia
            state[i, 4 + c] += gain
            state[i, 8 + c] += turn
            state[i, c] += state[i, 4 + c] * dt
            squared += state[i, 4 + c] * state[i, 4 + c]
            away += (state[i, c] - home[i, c]) * (state[i, c] - home[i, c])
            spun += state[i, 8 + c] * state[i, 8 + c]
            pulled, twisted = pulled + gain * gain, twisted + turn * turn
            force[i, c] = 0.0
            force[i, 3 + c] = 0.0
        fastest = max(fastest, squared)
        strayed = strayed or not away <= home[i, 3]
        # Only NaN differs from itself.
        finite = finite and squared == squared
        r = state[i, 3]
        slow = squared <= slowest * r and spun * r <= slowest
        # A torque is measured against weight times radius: T / (m r) = 0.4 r times the angular acceleration.
        gained = max(least, share * load[i] * by_mass)
        balanced = pulled <= gained * gained and 0.16 * r * r * twisted <= gained * gained
        calm[i] = calm[i] + 1 if slow and balanced else 0
    lists.woke[slab] += woke
    return math.sqrt(fastest) * dt if finite else np.nan, strayed


@kernel
def move_slab(
    slab: int,
    particles: Particles,
    lists: Neighbours,
    dormant: Dormant,
    field: Any,
    gravity: Floats,
    dt: float,
) -> None:
    """Move the particles of a slab, and note the longest way of one and whether one has strayed."""
    if len(dormant.limits) > 0:
        stride, strayed = move_watched(slab, particles, lists, dormant, field, gravity, dt)
    else:
        first, last = lists.slab_start[slab], lists.slab_start[slab + 1]
        stride, strayed = move(first, last, particles, lists.home, field, gravity, dt)
    lists.stride[slab] = stride
    if strayed:
        lists.strayed[slab] = 1


@kernel
def forces_of_slab(
    slab: int,
    particles: Particles,
    lists: Neighbours,
    dormant: Dormant,
    walls: Walls,
    near: WallList,
    model: ContactModel,
    tables: Tables,
    dt: float,
) -> None:
    """Pairs, then walls, of one slab."""
    slab_forces(slab, particles, lists, dormant, model, tables, dt)
    first, last = lists.slab_start[slab], lists.slab_start[slab + 1]
    fresh = lists.fresh[0] > 0
    wall_forces(first, last, particles, lists.home, dormant, fresh, walls, near, model, tables, dt)


@kernel
def finish_slabs(
    turn: int,
    particles: Particles,
    lists: Neighbours,
    dormant: Dormant,
    walls: Walls,
    near: WallList,
    model: ContactModel,
    tables: Tables,
    gravity: Floats,
    dt: float,
) -> None:
    """Forces of the odd slab 2 turn - 1, then move it and the even slab after it.

    By then all even slabs have their own forces, so both have all of theirs and nobody needs their old positions.
    """
    odd, even = 2 * turn - 1, 2 * turn
    if odd >= 0:
        forces_of_slab(odd, particles, lists, dormant, walls, near, model, tables, dt)
        move_slab(odd, particles, lists, dormant, model.field, gravity, dt)
    if even < len(lists.slab_start) - 1:
        move_slab(even, particles, lists, dormant, model.field, gravity, dt)


@kernel
def is_stale(lists: Neighbours) -> bool:
    """Count the ways of the last step; True when a particle may have left its neighbours' knowledge, or is lost
    (a position that is not finite), so that the search, which checks, comes next."""
    stale = False
    lists.fresh[0] = 0
    last = len(lists.stride) - 1
    for k in range(last + 1):
        lists.way[k] += max(lists.stride[k], lists.stride[min(k + 1, last)])
        if lists.strayed[k] > 0 or lists.full[k] > 0:
            stale = True
    return stale


@kernel
def advance_serial(
    first: int,
    steps: int,
    particles: Particles,
    lists: Neighbours,
    dormant: Dormant,
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
) -> tuple[int, bool]:
    """Up to `steps` steps from step number `first` on, fewer when the neighbour list goes stale.

    Returns how many, and whether it did; a particle that goes through a wall counts as stale too, so that the
    caller sees it at once. Half the skin is for the way of the walls, beside what a particle may stray. The
    laws come one by one because a threaded loop takes no nested tuples.
    """
    model = ContactModel(normal, tangential, rolling, cohesion, field)
    count = len(lists.slab_start) - 1
    for step in range(steps):
        # One sweep while the slabs are in the cache, in the order of sums of the threaded loop.
        for turn in range(count // 2 + 1):
            if 2 * turn < count:
                forces_of_slab(2 * turn, particles, lists, dormant, walls, near, model, tables, dt)
            if 2 * turn - 1 < count:
                finish_slabs(turn, particles, lists, dormant, walls, near, model, tables, gravity, dt)
        way = place_walls(walls, (first + step + 1) * dt, dt)
        if is_stale(lists) or near.alarm[0] or not way <= 0.5 * skin:
            return step + 1, True
    return steps, False


@parallel_kernel
def advance_threaded(
    first: int,
    steps: int,
    particles: Particles,
    lists: Neighbours,
    dormant: Dormant,
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
    workers: int,
) -> tuple[int, bool]:
    """`advance_serial` with the slabs shared among `workers` threads, which meet twice a step; the same bits."""
    # Threaded loops take no tuple of tuples.
    even, odd = share_slabs(lists, near, dormant.state, workers)
    even_turn, even_start, odd_turn, odd_start = even.turn, even.start, odd.turn, odd.start
    for step in range(steps):
        for worker in prange(workers):
            model = ContactModel(normal, tangential, rolling, cohesion, field)
            for k in range(even_start[worker], even_start[worker + 1]):
                forces_of_slab(2 * even_turn[k], particles, lists, dormant, walls, near, model, tables, dt)
        for worker in prange(workers):
            model = ContactModel(normal, tangential, rolling, cohesion, field)
            for k in range(odd_start[worker], odd_start[worker + 1]):
                finish_slabs(odd_turn[k], particles, lists, dormant, walls, near, model, tables, gravity, dt)
        way = place_walls(walls, (first + step + 1) * dt, dt)
        if is_stale(lists) or near.alarm[0] or not way <= 0.5 * skin:
            return step + 1, True
    return steps, False

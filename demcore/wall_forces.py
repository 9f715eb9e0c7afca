"""The one loop over contacts with walls, a slab of particles at a time, after the slab's pairs.

Notation: n unit normal from the wall to the particle; d distance of the centre to the wall, which is the arm;
v relative velocity of the surfaces at the contact; slot: a row of the wall list.
A wall contact writes to its own particle only, so slabs need no order among themselves.
"""

from __future__ import annotations

import math

import numpy as np

from demcore.contact.model import ContactModel, Vec3
from demcore.geometry.motion import surface_velocity, to_body, turn_to_world, vector_at
from demcore.geometry.surfaces import plane_distance, revolution_distance
from demcore.geometry.wall_rows import PLANE, PROFILE, SPIN_NOW, TRIANGLES, Walls
from demcore.jit import kernel, leaf
from demcore.mesh_contacts import (
    ACCEPTED,
    carry_histories,
    choose_contacts,
    hit_normal,
    measure_hits,
)
from demcore.particles import Particles
from demcore.wall_list import STATE, WallList, forget_slot
from demcore.wrench import OVERLAP, Tables, contact_wrench, recall, remember, series_stiffness, touching_pair

# A step may miss its own length by this much when it is compared with the way through a wall.
CROSSING_SLACK = 1.05


@leaf
def wall_distance(walls: Walls, w: int, x: float, y: float, z: float) -> tuple[float, Vec3]:
    """Distance of a point of the world to analytic wall w, m, and the unit normal towards the point."""
    q = to_body(walls, w, x, y, z)
    if walls.kind[w] == PLANE:
        d, n = plane_distance(q)
    else:
        s = walls.shape
        d, n = revolution_distance(s[w, PROFILE], s[w, PROFILE + 1], s[w, PROFILE + 2], s[w, PROFILE + 3], q)
    return d, turn_to_world(walls, w, n)


@leaf
def has_crossed(near: WallList, k: int, radius: float, d: float, n: Vec3, speed: float, dt: float) -> bool:
    """True when the centre went through the surface that slot k touched at the step before.

    The normal has turned round, and the way through the surface is no longer than what was moved. (Without the
    second half a ball that wobbles in a funnel would be reported: its nearest side changes.)
    """
    if d < 0.0:
        return True
    if near.history[k, OVERLAP] == 0.0:
        return False
    m = vector_at(near.normal, k, 0)
    if m.x * n.x + m.y * n.y + m.z * n.z >= 0.0:
        return False
    return bool(abs(radius - near.history[k, OVERLAP]) + d <= CROSSING_SLACK * speed * dt)


@leaf
def press(
    model: ContactModel,
    tables: Tables,
    particles: Particles,
    walls: Walls,
    near: WallList,
    i: int,
    k: int,
    d: float,
    n: Vec3,
    dt: float,
) -> bool:
    """Add the force of slot k on particle i, at the distance d along n; True when the particle went through."""
    state, force, w = particles.state, particles.force, near.wall[k]
    r, m = state[i, 3], state[i, 7]
    surface = surface_velocity(
        walls, w, state[i, 0] - d * n.x, state[i, 1] - d * n.y, state[i, 2] - d * n.z, n
    )
    vx, vy, vz = state[i, 4] - surface.x, state[i, 5] - surface.y, state[i, 6] - surface.z
    crossed = has_crossed(near, k, r, d, n, math.sqrt(vx * vx + vy * vy + vz * vz), dt)
    wx, wy, wz = state[i, 8], state[i, 9], state[i, 10]
    v = Vec3(
        vx - d * (wy * n.z - wz * n.y),
        vy - d * (wz * n.x - wx * n.z),
        vz - d * (wx * n.y - wy * n.x),
    )
    a, b = particles.material[i], walls.material[w]
    stiffness = series_stiffness(tables.youngs[a], tables.youngs[b], 2.0 * r, 2.0 * r)
    pair = touching_pair(tables, a, b, stiffness, m, r)
    turning = vector_at(walls.pose, w, SPIN_NOW)
    spin = Vec3(wx - turning.x, wy - turning.y, wz - turning.z)
    wrench = contact_wrench(model, pair, r - d, n, v, spin, recall(near.history, k), dt)
    remember(near.history, k, wrench.history)
    f, ft, couple = wrench.force, wrench.tangential, wrench.couple
    force[i, 0] += f.x
    force[i, 1] += f.y
    force[i, 2] += f.z
    force[i, 3] += couple.x - d * (n.y * ft.z - n.z * ft.y)
    force[i, 4] += couple.y - d * (n.z * ft.x - n.x * ft.z)
    force[i, 5] += couple.z - d * (n.x * ft.y - n.y * ft.x)
    near.normal[k, 0], near.normal[k, 1], near.normal[k, 2] = n.x, n.y, n.z
    near.push[k, 0], near.push[k, 1], near.push[k, 2] = f.x, f.y, f.z
    return crossed


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
    """Add the forces of all wall contacts of particles first to last - 1; sets the alarm of the list when one of
    them went through a wall."""
    state = particles.state
    for p in range(np.searchsorted(near.owner, first), np.searchsorted(near.owner, last)):
        i = near.owner[p]
        x, y, z, r = state[i, 0], state[i, 1], state[i, 2], state[i, 3]
        k = near.start[p]
        while k < near.start[p + 1]:
            w = near.wall[k]
            end = k + 1
            if walls.kind[w] == TRIANGLES:
                while end < near.start[p + 1] and near.wall[end] == w:
                    end += 1
                if measure_hits(near, walls, k, end, x, y, z, r):
                    choose_contacts(near, k, end, r)
                carry_histories(near, k, end, r)
            for slot in range(k, end):
                if walls.kind[w] == TRIANGLES:
                    d, n = near.hit[slot, 0], hit_normal(near, slot)
                    touches = near.hit[slot, STATE] == ACCEPTED
                else:
                    d, n = wall_distance(walls, w, x, y, z)
                    touches = d < r
                if not touches:
                    if near.history[slot, OVERLAP] != 0.0:
                        forget_slot(near, slot)
                elif press(model, tables, particles, walls, near, i, slot, d, n, dt):
                    near.crossed[p] = w
                    near.alarm[0] = True
            k = end

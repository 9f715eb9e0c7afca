"""The one loop over contacts with walls, a slab of particles at a time, after the slab's pairs.

Notation: n unit normal from the wall to the particle; d distance of the centre to the wall, which is the arm;
v relative velocity of the surfaces at the contact; slot: a row of the wall list.
A wall contact writes to its own particle only, so slabs need no order among themselves.
"""

from __future__ import annotations

import math

import numpy as np

from demcore.contact.model import ContactModel, Vec3
from demcore.dormant import AWAKE, DORMANT, Dormant
from demcore.geometry.motion import surface_velocity, to_body, turn_to_world, vector_at
from demcore.geometry.surfaces import plane_distance, revolution_distance
from demcore.geometry.wall_rows import PLANE, PROFILE, SPIN_NOW, TRIANGLES, Walls
from demcore.jit import kernel, leaf
from demcore.mesh_contacts import ACCEPTED, carry_histories, choose_contacts, measure_hits
from demcore.particles import Floats, Particles
from demcore.wall_list import STATE, WallList
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

# A step may miss its own length by this much when it is compared with the way through a wall.
CROSSING_SLACK = 1.05


@leaf
def wall_distance(
    kind: int, shape: Floats, pose: Floats, w: int, x: float, y: float, z: float
) -> tuple[float, Vec3]:
    """Distance of a point of the world to analytic wall w, m, and the unit normal towards the point."""
    q = to_body(pose, w, x, y, z)
    if kind == PLANE:
        d, n = plane_distance(q)
    else:
        s = shape
        d, n = revolution_distance(s[w, PROFILE], s[w, PROFILE + 1], s[w, PROFILE + 2], s[w, PROFILE + 3], q)
    return d, turn_to_world(pose, w, n)


@leaf
def has_crossed(
    before: Floats, overlap: float, k: int, radius: float, d: float, n: Vec3, speed: float, dt: float
) -> bool:
    """True when the centre went through the surface that slot k touched at the step before, with `overlap` and the
    normal in row k of `before`.

    The normal has turned round, and the way through the surface is no longer than what was moved. (Without the
    second half a ball that wobbles in a funnel would be reported: its nearest side changes.)
    """
    if d < 0.0:
        return True
    if overlap == 0.0:
        return False
    m = vector_at(before, k, 0)
    if m.x * n.x + m.y * n.y + m.z * n.z >= 0.0:
        return False
    return bool(abs(radius - overlap) + d <= CROSSING_SLACK * speed * dt)


@kernel
def meet_triangles(
    near: WallList, walls: Walls, begin: int, end: int, x: float, y: float, z: float, r: float, away: float
) -> None:
    """Decide which of the slots begin to end - 1, all of one mesh, are contacts of a particle."""
    if measure_hits(near, walls, begin, end, x, y, z, r, away):
        choose_contacts(near, begin, end, r)
    carry_histories(near, begin, end, r)


@leaf
def add_wrench(rows: Floats, i: int, f: Vec3, tx: float, ty: float, tz: float) -> None:
    """Add a force and a torque to row i."""
    rows[i, 0] += f.x
    rows[i, 1] += f.y
    rows[i, 2] += f.z
    rows[i, 3] += tx
    rows[i, 4] += ty
    rows[i, 5] += tz


@leaf
def note_load(dormant: Dormant, i: int, f: Vec3, fresh: bool) -> None:
    """Add half of a force to what particle i carries, in a fresh step; of a dormant one it was noted before."""
    if fresh and len(dormant.load) > 0 and dormant.state[i] != DORMANT:
        dormant.load[i] += 0.5 * math.sqrt(f.x * f.x + f.y * f.y + f.z * f.z)


@kernel
def wall_forces(
    first: int,
    last: int,
    particles: Particles,
    home: Floats,
    dormant: Dormant,
    fresh: bool,
    walls: Walls,
    near: WallList,
    model: ContactModel,
    tables: Tables,
    dt: float,
) -> None:
    """Add the forces of all wall contacts of particles first to last - 1; sets the alarm of the list when one of
    them went through a wall. Those of held particles are computed in the `fresh` step after a search only, and
    kept in `frozen`: such particles are near walls that stand. What a particle cannot have reached
    from its `home` is not looked at: of a grain on the belt that is all but one of the triangles around it.

    Every array has a name of its own: one that is taken out of its record in the loop is counted as a reference
    there, which cost four times the arithmetic.
    """
    state, force, kinds = particles.state, particles.force, particles.material
    slot_wall, start, history, hit = near.wall, near.start, near.history, near.hit
    normal, push, clear = near.normal, near.push, near.clear
    wall_kind, pose, shape, wall_material = walls.kind, walls.pose, walls.shape, walls.material
    youngs, values = tables.youngs, tables.pair
    mode, frozen = dormant.state, dormant.frozen
    for p in range(np.searchsorted(near.owner, first), np.searchsorted(near.owner, last)):
        i = near.owner[p]
        is_held = mode[i] != AWAKE
        if is_held and not fresh:
            continue
        x, y, z, r, m = state[i, 0], state[i, 1], state[i, 2], state[i, 3], state[i, 7]
        wx, wy, wz = state[i, 8], state[i, 9], state[i, 10]
        hx, hy, hz = x - home[i, 0], y - home[i, 1], z - home[i, 2]
        away = hx * hx + hy * hy + hz * hz
        met = -1
        for k in range(start[p], start[p + 1]):
            w = slot_wall[k]
            if wall_kind[w] == TRIANGLES:
                if w != met:
                    met, end = w, k + 1
                    while end < start[p + 1] and slot_wall[end] == w:
                        end += 1
                    meet_triangles(near, walls, k, end, x, y, z, r, away)
                d, n = hit[k, 0], vector_at(hit, k, 1)
                touches = hit[k, STATE] == ACCEPTED
            elif away < clear[k]:
                d, n = np.inf, Vec3(0.0, 0.0, 0.0)
                touches = False
            else:
                d, n = wall_distance(wall_kind[w], shape, pose, w, x, y, z)
                touches = d < r
            if not touches:
                if history[k, OVERLAP] != 0.0:
                    forget(history, k)
                    push[k, 0] = push[k, 1] = push[k, 2] = 0.0
                continue
            surface = surface_velocity(pose, shape, w, x - d * n.x, y - d * n.y, z - d * n.z, n)
            vx, vy, vz = state[i, 4] - surface.x, state[i, 5] - surface.y, state[i, 6] - surface.z
            speed = math.sqrt(vx * vx + vy * vy + vz * vz)
            if has_crossed(normal, history[k, OVERLAP], k, r, d, n, speed, dt):
                near.crossed[p] = w
                near.alarm[0] = True
            v = Vec3(
                vx - d * (wy * n.z - wz * n.y),
                vy - d * (wz * n.x - wx * n.z),
                vz - d * (wx * n.y - wy * n.x),
            )
            a, b = kinds[i], wall_material[w]
            stiffness = series_stiffness(youngs[a], youngs[b], 2.0 * r, 2.0 * r)
            pair = touching_pair(values, a, b, stiffness, m, r)
            spin = Vec3(wx - pose[w, SPIN_NOW], wy - pose[w, SPIN_NOW + 1], wz - pose[w, SPIN_NOW + 2])
            wrench = contact_wrench(model, pair, r - d, n, v, spin, recall(history, k), dt)
            remember(history, k, wrench.history)
            f, ft, couple = wrench.force, wrench.tangential, wrench.couple
            tx = couple.x - d * (n.y * ft.z - n.z * ft.y)
            ty = couple.y - d * (n.z * ft.x - n.x * ft.z)
            tz = couple.z - d * (n.x * ft.y - n.y * ft.x)
            if is_held:
                add_wrench(frozen, i, f, tx, ty, tz)
            else:
                add_wrench(force, i, f, tx, ty, tz)
            note_load(dormant, i, f, fresh)
            normal[k, 0], normal[k, 1], normal[k, 2] = n.x, n.y, n.z
            push[k, 0], push[k, 1], push[k, 2] = f.x, f.y, f.z

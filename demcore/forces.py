"""The one loop over contacts: pairs and walls of a slab of particles, accumulated without races.

Notation: n unit normal from body j to body i; s overlap; v relative velocity of the surfaces at the contact
(i minus j); arm distance of a centre to the contact plane. Force F acts on i at the contact.

Why slabs: particles are sorted along one axis into slabs that are thicker than any contact is long, and a pair
is owned by its particle of lower index. The pairs of a slab then write to that slab and the next one only, and
they write to the next one in columns of their own. So all slabs can run at once, or one after another, and
every sum is made in the same order. No force is computed twice.

History of a contact, 10 numbers: elastic normal force, overlap (0: not in contact), age, sliding,
tangential spring (3), rolling couple (3).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.contact.laws import normal_force, rolling_couple, tangential_force
from demcore.contact.model import ContactModel, Pair, Vec3
from demcore.geometry.walls import wall_distance, wall_velocity
from demcore.jit import kernel, leaf
from demcore.particles import HANDED, Floats, Particles

HISTORY_WIDTH = 10


class Tables(NamedTuple):
    """Per material: Young's modulus (M,), Pa. Per pair of materials (M, M, 6): restitution, static and dynamic
    friction, rolling resistance, effective Young's and shear modulus (Pa)."""

    youngs: Floats
    pair: Floats


class Neighbours(NamedTuple):
    """Half list by owner: partners of particle i are partner[start[i]:start[i + 1]], history alongside.

    wall_* is the same for walls; slab_start (S + 1,) are the first particles of the slabs.
    """

    start: NDArray[np.int64]
    partner: NDArray[np.int32]
    history: Floats
    wall_start: NDArray[np.int64]
    wall_index: NDArray[np.int32]
    wall_history: Floats
    slab_start: NDArray[np.int64]


class Walls(NamedTuple):
    kind: NDArray[np.int64]
    data: Floats


@leaf
def touching_pair(
    tables: Tables, a: int, b: int, size_i: float, size_j: float, mass: float, radius: float
) -> Pair:
    """What the laws may know of a contact between materials a and b; element by element, because a row as an
    array of its own would be counted as a reference, once per contact."""
    p = tables.pair
    return Pair(
        size_i,
        size_j,
        mass,
        radius,
        tables.youngs[a],
        tables.youngs[b],
        p[a, b, 4],
        p[a, b, 5],
        p[a, b, 0],
        p[a, b, 1],
        p[a, b, 2],
        p[a, b, 3],
    )


@leaf
def contact_wrench(
    model: ContactModel,
    pair: Pair,
    s: float,
    n: Vec3,
    v: Vec3,
    spin: Vec3,
    history: Floats,
    k: int,
    dt: float,
) -> tuple[Vec3, Vec3, Vec3]:
    """Total force, tangential force and rolling couple on body i; updates history row k."""
    v_n = v.x * n.x + v.y * n.y + v.z * n.z
    normal = normal_force(model.normal, pair, s, v_n, history[k, 0], history[k, 1], history[k, 2], dt)
    tangent = tangential_force(
        model.tangential,
        pair,
        normal,
        n,
        Vec3(v.x - v_n * n.x, v.y - v_n * n.y, v.z - v_n * n.z),
        Vec3(history[k, 4], history[k, 5], history[k, 6]),
        history[k, 3],
        dt,
    )
    couple = rolling_couple(
        model.rolling,
        pair,
        normal,
        tangent.stiffness,
        n,
        spin,
        Vec3(history[k, 7], history[k, 8], history[k, 9]),
        dt,
    )
    history[k, 0] = normal.elastic
    history[k, 1] = s
    history[k, 2] = normal.age
    history[k, 3] = tangent.sliding
    history[k, 4] = tangent.spring.x
    history[k, 5] = tangent.spring.y
    history[k, 6] = tangent.spring.z
    history[k, 7] = couple.x
    history[k, 8] = couple.y
    history[k, 9] = couple.z
    ft = tangent.force
    f = Vec3(normal.force * n.x + ft.x, normal.force * n.y + ft.y, normal.force * n.z + ft.z)
    return f, ft, couple


@leaf
def forget(history: Floats, k: int) -> None:
    """Both histories go to zero when a contact opens."""
    for c in range(HISTORY_WIDTH):
        history[k, c] = 0.0


@kernel
def slab_forces(
    first: int,
    last: int,
    particles: Particles,
    neighbours: Neighbours,
    walls: Walls,
    normal_law: Any,
    tangential_law: Any,
    rolling_law: Any,
    tables: Tables,
    dt: float,
) -> None:
    """Add the forces of all contacts owned by particles first to last - 1, which are a whole slab."""
    model = ContactModel(normal_law, tangential_law, rolling_law)
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
            pair = touching_pair(tables, a, b, 2.0 * r, 2.0 * rj, m * mj / (m + mj), r * rj / reach)
            spin = Vec3(wx - state[j, 8], wy - state[j, 9], wz - state[j, 10])
            f, ft, couple = contact_wrench(model, pair, s, n, v, spin, history, k, dt)
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
        for k in range(neighbours.wall_start[i], neighbours.wall_start[i + 1]):
            w = neighbours.wall_index[k]
            d, n = wall_distance(walls.kind[w], walls.data, w, x, y, z)
            if d >= r:
                if neighbours.wall_history[k, 1] != 0.0:
                    forget(neighbours.wall_history, k)
                continue
            surface = wall_velocity(walls.data, w, x - d * n.x, y - d * n.y, z - d * n.z)
            v = Vec3(
                vx - surface.x - d * (wy * n.z - wz * n.y),
                vy - surface.y - d * (wz * n.x - wx * n.z),
                vz - surface.z - d * (wx * n.y - wy * n.x),
            )
            b = int(walls.data[w, 17])
            pair = touching_pair(tables, a, b, 2.0 * r, 2.0 * r, m, r)
            spin = Vec3(wx - walls.data[w, 11], wy - walls.data[w, 12], wz - walls.data[w, 13])
            f, ft, couple = contact_wrench(model, pair, r - d, n, v, spin, neighbours.wall_history, k, dt)
            fx += f.x
            fy += f.y
            fz += f.z
            tx += couple.x - d * (n.y * ft.z - n.z * ft.y)
            ty += couple.y - d * (n.z * ft.x - n.x * ft.z)
            tz += couple.z - d * (n.x * ft.y - n.y * ft.x)
        force[i, 0] += fx
        force[i, 1] += fy
        force[i, 2] += fz
        force[i, 3] += tx
        force[i, 4] += ty
        force[i, 5] += tz

"""One contact, whatever touches: from overlap, normal and relative velocity to forces, couple and new history.

Notation: n unit normal from body j to body i; s overlap; v relative velocity of the surfaces at the contact
(i minus j). Force F acts on i at the contact. Everything here is scalar and pure: the loops decide how contacts
lie in memory (by rows for walls, in blocks for pairs of particles).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from demcore.contact.laws import cohesion_force, normal_force, rolling_couple, tangential_force
from demcore.contact.model import ContactModel, History, Pair, Vec3
from demcore.jit import leaf
from demcore.particles import Floats

# Numbers in a History: elastic, overlap, age, sliding, spring (3), couple (3). OVERLAP is the column that says
# whether there is a contact.
HISTORY_WIDTH = 10
OVERLAP = 1


class Tables(NamedTuple):
    """Per material: Young's modulus (M,), Pa. Per pair of materials (M, M, 8): restitution, static and dynamic
    friction, rolling resistance, effective Young's and shear modulus (Pa), 1/e^2, damping ratio."""

    youngs: Floats
    pair: Floats


def material_tables(youngs: Floats, pair: Floats) -> Tables:
    """Tables from Young's moduli (M,) and the first six pair values (M, M, 6); see `Tables` and `Pair`."""
    log_e = np.log(pair[:, :, 0])
    ratio = -log_e / np.sqrt(log_e**2 + np.pi**2)
    return Tables(youngs, np.dstack([pair, pair[:, :, 0] ** -2.0, ratio]))


class Wrench(NamedTuple):
    """What a contact does to body i: total force and its tangential part, N; rolling couple, N m; new history."""

    force: Vec3
    tangential: Vec3
    couple: Vec3
    history: History


@leaf
def series_stiffness(youngs_i: float, youngs_j: float, size_i: float, size_j: float) -> float:
    """K_l = k_i k_j / (k_i + k_j) with k = E L, N/m."""
    k_i = youngs_i * size_i
    k_j = youngs_j * size_j
    return k_i * k_j / (k_i + k_j)


@leaf
def touching_pair(p: Floats, a: int, b: int, stiffness: float, mass: float, radius: float) -> Pair:
    """What the laws may know of a contact between materials a and b; `p` are the pair values of `Tables`, read
    element by element, because a row as an array of its own would be counted as a reference, once per contact."""
    return Pair(
        mass,
        radius,
        stiffness,
        p[a, b, 4],
        p[a, b, 5],
        p[a, b, 0],
        p[a, b, 6],
        p[a, b, 7],
        p[a, b, 1],
        p[a, b, 2],
        p[a, b, 3],
    )


@leaf
def contact_wrench(
    model: ContactModel, pair: Pair, s: float, n: Vec3, v: Vec3, spin: Vec3, before: History, dt: float
) -> Wrench:
    """All laws of the model on one contact; `spin` is the relative angular velocity, rad/s."""
    v_n = v.x * n.x + v.y * n.y + v.z * n.z
    normal = normal_force(model.normal, pair, s, v_n, before.elastic, before.overlap, before.age, dt)
    along = Vec3(v.x - v_n * n.x, v.y - v_n * n.y, v.z - v_n * n.z)
    t = tangential_force(model.tangential, pair, normal, n, along, before.spring, before.sliding, dt)
    couple = rolling_couple(model.rolling, pair, normal, t.stiffness, n, spin, before.couple, dt)
    ft = t.force
    # Friction and rolling resistance know what presses; the attraction only takes from the sum.
    fn = normal.force - cohesion_force(model.cohesion, pair, s)
    force = Vec3(fn * n.x + ft.x, fn * n.y + ft.y, fn * n.z + ft.z)
    return Wrench(force, ft, couple, History(normal.elastic, s, normal.age, t.sliding, t.spring, couple))


@leaf
def recall(rows: Floats, k: int) -> History:
    """History row k of an (K, HISTORY_WIDTH) array."""
    return History(
        rows[k, 0],
        rows[k, 1],
        rows[k, 2],
        rows[k, 3],
        Vec3(rows[k, 4], rows[k, 5], rows[k, 6]),
        Vec3(rows[k, 7], rows[k, 8], rows[k, 9]),
    )


@leaf
def remember(rows: Floats, k: int, h: History) -> None:
    """Write history row k."""
    rows[k, 0], rows[k, 1], rows[k, 2], rows[k, 3] = h.elastic, h.overlap, h.age, h.sliding
    rows[k, 4], rows[k, 5], rows[k, 6] = h.spring.x, h.spring.y, h.spring.z
    rows[k, 7], rows[k, 8], rows[k, 9] = h.couple.x, h.couple.y, h.couple.z


@leaf
def forget(rows: Floats, k: int) -> None:
    """Both histories go to zero when a contact opens."""
    for c in range(HISTORY_WIDTH):
        rows[k, c] = 0.0

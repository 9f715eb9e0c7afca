"""One contact, whatever touches: from overlap, normal and relative velocity to forces, couple and new history.

Notation: n unit normal from body j to body i; s overlap; v relative velocity of the surfaces at the contact
(i minus j). Force F acts on i at the contact.

History of a contact, HISTORY_WIDTH numbers: elastic normal force, overlap (0: not in contact), age, sliding,
tangential spring (3; a force or a displacement, as the law has it), rolling couple (3).
"""

from __future__ import annotations

from typing import NamedTuple

from demcore.contact.laws import cohesion_force, normal_force, rolling_couple, tangential_force
from demcore.contact.model import ContactModel, Pair, Vec3
from demcore.jit import leaf
from demcore.particles import Floats

HISTORY_WIDTH = 10


class Tables(NamedTuple):
    """Per material: Young's modulus (M,), Pa. Per pair of materials (M, M, 6): restitution, static and dynamic
    friction, rolling resistance, effective Young's and shear modulus (Pa)."""

    youngs: Floats
    pair: Floats


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
    # Friction and rolling resistance know what presses; the attraction only takes from the sum.
    fn = normal.force - cohesion_force(model.cohesion, pair, s)
    f = Vec3(fn * n.x + ft.x, fn * n.y + ft.y, fn * n.z + ft.z)
    return f, ft, couple


@leaf
def forget(history: Floats, k: int) -> None:
    """Both histories go to zero when a contact opens."""
    for c in range(HISTORY_WIDTH):
        history[k, c] = 0.0

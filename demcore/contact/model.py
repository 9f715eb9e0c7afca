"""A contact model is a composition of laws; each law is a NamedTuple of its numerics, one file each.

The loops over contacts and particles know only the records below and the five generic calls of laws.py:
`normal_force`, `tangential_force`, `rolling_couple`, `cohesion_force` and `field_wrench`.
"""

from __future__ import annotations

from typing import Any, NamedTuple


class Vec3(NamedTuple):
    x: float
    y: float
    z: float


class Pair(NamedTuple):
    """What a law may know of the two touching bodies; at a wall body j is the wall.

    mass            effective mass m_i m_j / (m_i + m_j), kg; at a wall m_i
    radius          effective radius r_i r_j / (r_i + r_j), m; at a wall r_i
    stiffness       linear loading stiffness of both sides in series, K_l = k_i k_j / (k_i + k_j) with k = E L, N/m
                    (L particle size, a sphere's diameter; a wall takes the size of what touches it)
    youngs, shear   effective moduli E*, G*, Pa
    restitution     coefficient of restitution e, (0, 1]
    unloading       1 / e^2: unloading over loading stiffness
    damping_ratio   beta = -ln e / sqrt(ln^2 e + pi^2)
    static, dynamic friction coefficients
    rolling         rolling resistance coefficient

    Logarithms and divisions that depend on materials only are done once, not in the loop over contacts.
    """

    mass: float
    radius: float
    stiffness: float
    youngs: float
    shear: float
    restitution: float
    unloading: float
    damping_ratio: float
    static: float
    dynamic: float
    rolling: float


class History(NamedTuple):
    """What a contact remembers from step to step; all zero when it opens.

    elastic (N) and overlap (m; 0: not in contact) of the normal law; age in contact, s; sliding 1.0 or 0.0;
    tangential spring (N, or a displacement in m, as the law has it) and rolling couple, N m: both as they act on
    body i.
    """

    elastic: float
    overlap: float
    age: float
    sliding: float
    spring: Vec3
    couple: Vec3


class Normal(NamedTuple):
    """Result of a normal law.

    force        total normal force, N, >= 0 without cohesion
    elastic      what the law remembers: its last elastic force, or the largest one, N
    stiffness    tangential laws scale theirs with it, N/m
    damping      viscous coefficient to apply in the tangent plane while sticking, kg/s
    age          time in contact, s
    """

    force: float
    elastic: float
    stiffness: float
    damping: float
    age: float


class Tangential(NamedTuple):
    """force: total on body i; spring: what is remembered; sliding: 1.0 while slipping at speed, else 0.0;
    stiffness: tangential stiffness used, N/m."""

    force: Vec3
    spring: Vec3
    sliding: float
    stiffness: float


class Body(NamedTuple):
    """What a field law may know of one particle: position m, velocity m/s, spin rad/s, radius m, mass kg."""

    position: Vec3
    velocity: Vec3
    spin: Vec3
    radius: float
    mass: float


class FieldWrench(NamedTuple):
    """Force, N, and torque about the centre, N m, of a field on one particle."""

    force: Vec3
    torque: Vec3


class ContactModel(NamedTuple):
    """The laws of a simulation. Each field is a NamedTuple whose type selects the implementation.

    Cohesion acts along the normal while two bodies touch, and no longer. It presses them together, so friction
    and rolling resistance are limited by the force that presses (what the normal law gives), not by the rest
    that is left after the attraction: two grains that cling without load still hold each other by friction.
    """

    normal: Any
    tangential: Any
    rolling: Any
    cohesion: Any
    field: Any

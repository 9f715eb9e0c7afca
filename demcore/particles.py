"""How particles lie in memory while they move: one row a particle, so that a contact touches few cache lines.

state   (N, 12) float64: X Y Z R | VX VY VZ M | WX WY WZ I    position m, radius m, velocity m/s, mass kg,
        angular velocity rad/s, moment of inertia kg m2
force   (N, 6) float64: force N, torque N m, summed over contacts, without gravity
material (N,) int32: row of the material tables; number (N,) int64: the particle's name, kept for life
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

X, Y, Z, R = 0, 1, 2, 3
VX, VY, VZ, M = 4, 5, 6, 7
WX, WY, WZ, I = 8, 9, 10, 11  # noqa: E741  (I is the field's symbol for the moment of inertia)

Floats = NDArray[np.float64]


class Particles(NamedTuple):
    state: Floats
    force: Floats
    material: NDArray[np.int32]
    number: NDArray[np.int64]


def spheres(
    position: Floats,
    radius: Floats,
    density: Floats | float,
    material: NDArray[np.int32] | None = None,
    velocity: Floats | None = None,
    spin: Floats | None = None,
) -> Particles:
    """Particles from plain arrays: position (N, 3) m, radius (N,) m, density kg/m3; at rest unless told."""
    count = len(radius)
    state = np.zeros((count, 12))
    state[:, X : Z + 1] = position
    state[:, R] = radius
    if velocity is not None:
        state[:, VX : VZ + 1] = velocity
    if spin is not None:
        state[:, WX : WZ + 1] = spin
    mass = density * (4.0 / 3.0 * np.pi) * state[:, R] ** 3
    state[:, M] = mass
    state[:, I] = 0.4 * mass * state[:, R] ** 2
    kinds = np.ones(count, np.int32) if material is None else np.asarray(material, np.int32)
    return Particles(state, np.zeros((count, 6)), kinds, np.arange(count))


def nothing() -> Particles:
    """No particles."""
    return spheres(np.zeros((0, 3)), np.zeros(0), 1.0)


def join(there: Particles, fresh: Particles, first_number: int) -> Particles:
    """Both, the fresh ones after the others and numbered from `first_number` on."""
    named = fresh._replace(number=first_number + np.arange(len(fresh.number)))
    pairs: Iterable[tuple[Any, Any]] = zip(there, named, strict=True)
    return Particles(*(np.concatenate(pair) for pair in pairs))

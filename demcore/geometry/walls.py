"""Analytic walls: where a sphere touches them and how their surface moves there.

A wall is a row of 18 numbers (WALL_WIDTH) and a kind. Columns: centre 0-2, axis 3-5 (unit), radius 6,
length 7, velocity 8-10 (m/s, the wall travels), angular velocity 11-13 (rad/s about the centre; the wall is a
body of revolution, so only its surface moves), surface velocity 14-16 (m/s, belts), material row 17.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.contact.model import Vec3
from demcore.errors import InputError
from demcore.jit import leaf

PLANE, DISC, CYLINDER = 0, 1, 2
WALL_WIDTH = 18
ZERO = (0.0, 0.0, 0.0)

Triple = tuple[float, float, float]


class Walls(NamedTuple):
    """All walls of a simulation as the kernels read them: kind (W,), -1 for one that has vanished, and rows."""

    kind: NDArray[np.int64]
    data: NDArray[np.float64]


@dataclass(frozen=True)
class Wall:
    """`plane`: half space below the axis; `disc`: two-sided; `cylinder`: open tube from the centre along the
    axis. Lengths in m, velocities in m/s and rad/s; `material` is the row of the material tables."""

    kind: str
    centre: Triple = ZERO
    axis: Triple = (0.0, 0.0, 1.0)
    radius: float = 0.0
    length: float = 0.0
    velocity: Triple = ZERO
    angular_velocity: Triple = ZERO
    surface_velocity: Triple = ZERO
    material: int = 0

    KINDS = ("plane", "disc", "cylinder")

    def __post_init__(self) -> None:
        if self.kind not in self.KINDS:
            raise InputError("wall.kind", self.kind, "one of " + ", ".join(self.KINDS))
        if not math.isfinite(sum(abs(a) for a in self.axis)) or not any(self.axis):
            raise InputError("wall.axis", self.axis, "a finite vector that is not zero")
        if self.kind != "plane" and not (math.isfinite(self.radius) and self.radius > 0.0):
            raise InputError("wall.radius", self.radius, "a positive radius in m")
        if self.kind == "cylinder" and not self.length > 0.0:
            raise InputError("wall.length", self.length, "a positive length in m")

    def row(self) -> NDArray[np.float64]:
        """The wall as the kernels read it."""
        axis = np.array(self.axis, float)
        axis /= np.sqrt((axis**2).sum())
        numbers: list[Sequence[float] | NDArray[np.float64]] = [
            self.centre,
            axis,
            (self.radius, self.length),
            self.velocity,
            self.angular_velocity,
            self.surface_velocity,
            (float(self.material),),
        ]
        return np.concatenate([np.asarray(n, float) for n in numbers])

    @property
    def kind_number(self) -> int:
        return self.KINDS.index(self.kind)


@leaf
def wall_distance(
    kind: int, walls: NDArray[np.float64], w: int, x: float, y: float, z: float
) -> tuple[float, Vec3]:
    """Distance of a point to wall w, m, and the unit normal towards the point.

    Negative only behind a plane, which is solid; 1e30 where there is no nearest point (a tube's axis).
    """
    qx, qy, qz = x - walls[w, 0], y - walls[w, 1], z - walls[w, 2]
    ax, ay, az = walls[w, 3], walls[w, 4], walls[w, 5]
    h = qx * ax + qy * ay + qz * az
    if kind == PLANE:
        return h, Vec3(ax, ay, az)
    rx, ry, rz = qx - h * ax, qy - h * ay, qz - h * az
    rho = math.sqrt(rx * rx + ry * ry + rz * rz)
    radius = walls[w, 6]
    if kind == DISC:
        if rho <= radius:
            side = 1.0 if h >= 0.0 else -1.0
            return abs(h), Vec3(side * ax, side * ay, side * az)
        along = 0.0
    else:
        along = min(max(h, 0.0), walls[w, 7])
        if rho == 0.0:
            return 1e30, Vec3(ax, ay, az)
    share = 1.0 - radius / rho
    dx = (h - along) * ax + share * rx
    dy = (h - along) * ay + share * ry
    dz = (h - along) * az + share * rz
    d = math.sqrt(dx * dx + dy * dy + dz * dz)
    if d == 0.0:
        return 0.0, Vec3(ax, ay, az)
    return d, Vec3(dx / d, dy / d, dz / d)


@leaf
def wall_velocity(walls: NDArray[np.float64], w: int, x: float, y: float, z: float) -> Vec3:
    """Velocity of the surface of wall w at a point: travel, rotation about the centre, belt. m/s."""
    qx, qy, qz = x - walls[w, 0], y - walls[w, 1], z - walls[w, 2]
    return Vec3(
        walls[w, 8] + walls[w, 12] * qz - walls[w, 13] * qy + walls[w, 14],
        walls[w, 9] + walls[w, 13] * qx - walls[w, 11] * qz + walls[w, 15],
        walls[w, 10] + walls[w, 11] * qy - walls[w, 12] * qx + walls[w, 16],
    )

"""Where particles are put and where they may be: boxes, upright cones and cylinders, inlets. Plain data."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from demcore.allowed import Triple, not_negative, positive, vector
from demcore.errors import InputError


@dataclass(frozen=True)
class Box:
    """An axis-aligned box from `lower` to `upper` corner, m. As a domain its sides may be infinite."""

    lower: Triple
    upper: Triple

    def __post_init__(self) -> None:
        for field, corner in (("box.lower", self.lower), ("box.upper", self.upper)):
            if len(corner) != 3 or any(math.isnan(c) for c in corner):
                raise InputError(field, corner, "three numbers, m")
        if not all(a < b for a, b in zip(self.lower, self.upper, strict=True)):
            raise InputError(
                "box.upper", self.upper, f"above the lower corner {self.lower} in every direction"
            )

    @property
    def is_bounded(self) -> bool:
        return all(math.isfinite(c) for c in (*self.lower, *self.upper))

    @property
    def volume(self) -> float:
        """m3."""
        return math.prod(b - a for a, b in zip(self.lower, self.upper, strict=True))

    @property
    def bottom(self) -> float:
        return self.lower[2]

    @property
    def top(self) -> float:
        return self.upper[2]

    def volume_below(self, z: float) -> float:
        """m3 of the part below height z (m)."""
        return self.volume * min(max((z - self.bottom) / (self.top - self.bottom), 0.0), 1.0)

    @property
    def bounds(self) -> Box:
        """The smallest box around it: itself."""
        return self

    @property
    def largest_radius(self) -> float:
        """Of a sphere that fits inside, m."""
        return 0.5 * min(b - a for a, b in zip(self.lower, self.upper, strict=True))


@dataclass(frozen=True)
class Cone:
    """An upright cone frustum standing on `base` (m): a hopper's inside, or a cylinder when both radii agree."""

    base: Triple
    height: float
    lower_radius: float
    upper_radius: float

    def __post_init__(self) -> None:
        vector("cone.base", self.base, "m")
        positive("cone.height", self.height, "m")
        not_negative("cone.lower_radius", self.lower_radius, "m")
        not_negative("cone.upper_radius", self.upper_radius, "m")
        if self.lower_radius == self.upper_radius == 0.0:
            raise InputError("cone.upper_radius", self.upper_radius, "more than 0 m at one end at least")

    @property
    def bottom(self) -> float:
        return self.base[2]

    @property
    def top(self) -> float:
        return self.base[2] + self.height

    @property
    def volume(self) -> float:
        """m3."""
        return self.volume_below(self.top)

    def volume_below(self, z: float) -> float:
        """m3 of the part below height z (m): pi h (a^2 + a b + b^2) / 3."""
        h = min(max(z - self.bottom, 0.0), self.height)
        a = self.lower_radius
        b = a + (self.upper_radius - a) * h / self.height
        return math.pi * h * (a * a + a * b + b * b) / 3.0

    @property
    def bounds(self) -> Box:
        """The smallest box around it."""
        wide = max(self.lower_radius, self.upper_radius)
        x, y, z = self.base
        return Box((x - wide, y - wide, z), (x + wide, y + wide, z + self.height))

    @property
    def largest_radius(self) -> float:
        """Of a sphere that fits inside, m: it touches the wide end and the side, or both ends.

        r (m) away from the wide end the side is wide - |slope| r from the axis, and that must leave r / cos a
        (a the side's angle to the axis).
        """
        slope = abs(self.upper_radius - self.lower_radius) / self.height
        wide = max(self.lower_radius, self.upper_radius)
        return min(wide / (slope + math.hypot(1.0, slope)), 0.5 * self.height)


def cylinder(base: Triple, radius: float, height: float) -> Cone:
    """The upright cylinder on `base`, m."""
    return Cone(base, height, radius, radius)


Region = Box | Cone


@dataclass(frozen=True)
class DiscInlet:
    """A round opening; particles are born with their whole sphere inside its outline."""

    centre: Triple
    radius: float
    normal: Triple = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        vector("inlet.centre", self.centre, "m")
        positive("inlet.radius", self.radius, "m")
        vector("inlet.normal", self.normal)
        if not any(self.normal):
            raise InputError("inlet.normal", self.normal, "a vector that is not zero")

    @property
    def largest_radius(self) -> float:
        """Of a particle that passes, m."""
        return self.radius

    @property
    def extent(self) -> float:
        """Farthest from its centre that the opening reaches, m."""
        return self.radius

    def points(self, uniform: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
        """Places (K, 3), m, for the centre of a sphere; `uniform` (K, 2) in [0, 1)."""
        n = np.array(self.normal) / math.hypot(*self.normal)
        # The axis that is least along the normal starts the plane.
        first = np.cross(n, np.eye(3)[int(np.argmin(np.abs(n)))])
        first /= math.sqrt(float(first @ first))
        second = np.cross(n, first)
        rho = (self.radius - radius) * np.sqrt(uniform[:, :1])
        angle = 2.0 * math.pi * uniform[:, 1:]
        across = np.cos(angle) * first + np.sin(angle) * second
        return np.asarray(np.array(self.centre) + rho * across, np.float64)


@dataclass(frozen=True)
class RectangleInlet:
    """A rectangular opening: its centre and the two half edges (m), at right angles to one another."""

    centre: Triple
    first: Triple
    second: Triple

    def __post_init__(self) -> None:
        vector("inlet.centre", self.centre, "m")
        for field, edge in (("inlet.first", self.first), ("inlet.second", self.second)):
            vector(field, edge, "m")
            if not any(edge):
                raise InputError(field, edge, "a half edge that is not zero")
        along = sum(a * b for a, b in zip(self.first, self.second, strict=True))
        if abs(along) > 1e-9 * math.hypot(*self.first) * math.hypot(*self.second):
            raise InputError("inlet.second", self.second, "a half edge at right angles to the first")

    @property
    def largest_radius(self) -> float:
        """Of a particle that passes, m."""
        return min(math.hypot(*self.first), math.hypot(*self.second))

    @property
    def extent(self) -> float:
        """Farthest from its centre that the opening reaches, m."""
        return math.hypot(*self.first, *self.second)

    def points(self, uniform: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
        """Places (K, 3), m, for the centre of a sphere; `uniform` (K, 2) in [0, 1)."""
        place = np.tile(np.array(self.centre, float), (len(uniform), 1))
        for share, edge in zip(uniform.T, (self.first, self.second), strict=True):
            length = math.hypot(*edge)
            place += ((2.0 * share - 1.0) * (length - radius) / length)[:, None] * np.array(edge)
        return place


Inlet = DiscInlet | RectangleInlet

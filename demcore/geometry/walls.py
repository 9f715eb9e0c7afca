"""What a wall is asked to be: shape, place, motion, belt, lifetime. Plain records; kernels read `wall_arrays`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from demcore.errors import InputError
from demcore.geometry.mesh import TriangleMesh

ZERO = (0.0, 0.0, 0.0)

Triple = tuple[float, float, float]


def _check_triple(field: str, value: Any, unit: str) -> None:
    try:
        numbers = [float(v) for v in value]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) != 3 or not all(math.isfinite(v) for v in numbers):
        raise InputError(field, value, f"three finite numbers{unit}")


def _check_axis(field: str, value: Any) -> None:
    _check_triple(field, value, "")
    if not 1e-100 < math.hypot(*value) < 1e100:
        raise InputError(field, value, "a vector that is not zero")


def _check_range(field: str, value: Any, lower: float, upper: float, allowed: str) -> None:
    """lower <= value <= upper; a NaN or something that is no number fails too."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not lower <= value <= upper:
        raise InputError(field, value, allowed)


@dataclass(frozen=True)
class Oscillation:
    """Back and forth about the wall's place: `amplitude` (m) times sin(2 pi frequency t + phase), and a turn by
    `angle` (rad) times the same sine about `axis` through the wall's pivot. Frequency in Hz, phase in rad.

    Raises InputError for what is not finite, a frequency that is not positive, an axis of zero.
    """

    amplitude: Triple = ZERO
    frequency: float = 1.0
    phase: float = 0.0
    angle: float = 0.0
    axis: Triple = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        _check_triple("oscillation.amplitude", self.amplitude, " in m")
        _check_range("oscillation.frequency", self.frequency, 1e-9, 1e9, "a positive frequency in Hz")
        _check_range("oscillation.phase", self.phase, -1e9, 1e9, "a finite angle in rad")
        _check_range("oscillation.angle", self.angle, -math.pi, math.pi, "-pi to pi rad")
        _check_axis("oscillation.axis", self.axis)


@dataclass(frozen=True)
class Wall:
    """One wall. Lengths in m, velocities in m/s and rad/s, times in s; `material` is a row of the tables.

    kind               `plane`: half space below the axis, solid. The others are thin and two-sided:
                       `disc`: ring from `inner_radius` to `radius`; `cylinder`: open tube from the centre along
                       the axis; `cone`: open frustum, `radius` at the centre, `end_radius` at centre + length
                       axis; `mesh`: `mesh`, its origin put at the centre
    velocity           the wall travels
    angular_velocity   the wall turns about the axis through `pivot` (default: the centre) that travels with it
    oscillation        comes on top of both
    moves_from, moves_until   outside this time the wall stands still where it is
    surface_velocity   belt: the surface runs along this vector, as it is at time 0, projected on the local face
                       and brought back to its length; where nothing is left of it the surface stands
    from_time, until_time     the wall is there from the first (inclusive) to the second (exclusive)
    name               for messages

    Raises InputError naming the field.
    """

    kind: str
    centre: Triple = ZERO
    axis: Triple = (0.0, 0.0, 1.0)
    radius: float = 0.0
    length: float = 0.0
    velocity: Triple = ZERO
    angular_velocity: Triple = ZERO
    surface_velocity: Triple = ZERO
    material: int = 0
    inner_radius: float = 0.0
    end_radius: float = 0.0
    mesh: TriangleMesh | None = None
    pivot: Triple | None = None
    oscillation: Oscillation | None = None
    moves_from: float = 0.0
    moves_until: float = math.inf
    from_time: float = 0.0
    until_time: float = math.inf
    name: str = ""

    KINDS = ("plane", "disc", "cylinder", "cone", "mesh")

    def __post_init__(self) -> None:
        if self.kind not in self.KINDS:
            raise InputError("wall.kind", self.kind, "one of " + ", ".join(self.KINDS))
        self._check_motion()
        self._check_shape()
        if not isinstance(self.material, int) or isinstance(self.material, bool) or self.material < 0:
            raise InputError("wall.material", self.material, "a row of the material tables")
        if not isinstance(self.name, str):
            raise InputError("wall.name", self.name, "a text")

    def _check_motion(self) -> None:
        _check_triple("wall.centre", self.centre, " in m")
        _check_axis("wall.axis", self.axis)
        _check_triple("wall.velocity", self.velocity, " in m/s")
        _check_triple("wall.angular_velocity", self.angular_velocity, " in rad/s")
        _check_triple("wall.surface_velocity", self.surface_velocity, " in m/s")
        if self.pivot is not None:
            _check_triple("wall.pivot", self.pivot, " in m")
        if self.oscillation is not None and not isinstance(self.oscillation, Oscillation):
            raise InputError("wall.oscillation", self.oscillation, "an Oscillation or None")
        for first, last in (("moves_from", "moves_until"), ("from_time", "until_time")):
            start, end = getattr(self, first), getattr(self, last)
            _check_range(f"wall.{first}", start, 0.0, 1e15, "a time in s, not negative")
            _check_range(f"wall.{last}", end, start, math.inf, f"a time in s, not before {first}")

    def _check_shape(self) -> None:
        kind, length = self.kind, "a positive length in m"
        if kind in ("disc", "cylinder"):
            _check_range("wall.radius", self.radius, 1e-12, 1e12, "a positive radius in m")
        if kind == "cone":
            _check_range("wall.radius", self.radius, 0.0, 1e12, "a radius in m, not negative")
            _check_range("wall.end_radius", self.end_radius, 0.0, 1e12, "a radius in m, not negative")
            if self.radius == self.end_radius == 0.0:
                raise InputError("wall.radius", self.radius, "a positive radius at one end of a cone")
        elif self.end_radius != 0.0:
            raise InputError("wall.end_radius", self.end_radius, "0, except for a cone")
        if kind in ("cylinder", "cone"):
            _check_range("wall.length", self.length, 1e-12, 1e12, length)
        if kind == "disc":
            below = math.nextafter(self.radius, 0.0)
            _check_range("wall.inner_radius", self.inner_radius, 0.0, below, "0 to less than the radius, m")
        elif self.inner_radius != 0.0:
            raise InputError("wall.inner_radius", self.inner_radius, "0, except for a disc")
        if (kind == "mesh") != isinstance(self.mesh, TriangleMesh):
            allowed = "a TriangleMesh" if kind == "mesh" else "None, except for a mesh"
            raise InputError("wall.mesh", type(self.mesh).__name__, allowed)

    @property
    def label(self) -> str:
        """Its name, or else its kind."""
        return self.name or self.kind

"""The parts of a single-bell charging plant as plain data: belt, lid with its hatch, deflector, hopper, bell, rod.

Notation: the origin is the paper's reference point, where the hopper's axis meets the joint of hopper and lid; z
is up, x runs across the drum's axis the way the belt runs ("far" is +x), y along the drum's axis. Lengths m,
speeds m/s, angles in degrees where the name says so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

from demcore.allowed import positive, within
from demcore.errors import InputError
from demcore.geometry.mesh import TriangleMesh

# A plant's lengths, m: beyond these a unit is wrong.
SHORTEST, LONGEST = 1e-3, 100.0


def _lengths(part: str, record: object, names: tuple[str, ...]) -> None:
    for name in names:
        within(f"{part}.{name}", getattr(record, name), SHORTEST, LONGEST, "m")


def _places(part: str, record: object, names: tuple[str, ...]) -> None:
    for name in names:
        within(f"{part}.{name}", getattr(record, name), -LONGEST, LONGEST, "m")


@dataclass(frozen=True)
class Hopper:
    """Below the rim at z = 0 a cylinder of `rim_radius`, `cylinder_height` deep, then a cone that narrows to
    `seat_radius` at the bell's seat, `seat_depth` below the rim."""

    rim_radius: float
    cylinder_height: float
    seat_radius: float
    seat_depth: float

    def __post_init__(self) -> None:
        _lengths("hopper", self, ("rim_radius", "cylinder_height", "seat_radius", "seat_depth"))
        if self.seat_depth <= self.cylinder_height:
            raise InputError(
                "hopper.seat_depth", self.seat_depth, f"below the cylinder, {self.cylinder_height:g} m"
            )
        if self.seat_radius > self.rim_radius:
            raise InputError(
                "hopper.seat_radius", self.seat_radius, f"at most the rim's, {self.rim_radius:g} m"
            )

    @property
    def cone_height(self) -> float:
        return self.seat_depth - self.cylinder_height

    def radius_at(self, z: float) -> float:
        """Of the inner wall at height z, m; the rim's above it, the seat's below."""
        up = min(max((z + self.seat_depth) / self.cone_height, 0.0), 1.0)
        return self.seat_radius + (self.rim_radius - self.seat_radius) * up


@dataclass(frozen=True)
class Bell:
    """An upright cone that closes the hopper at its seat and rises to the rod with `slope_deg`."""

    slope_deg: float

    def __post_init__(self) -> None:
        within("bell.slope_deg", self.slope_deg, 1.0, 85.0, "degrees")


@dataclass(frozen=True)
class Rod:
    """The upright rod on the axis that carries the bell, from the bell to `top` above the rim."""

    radius: float
    top: float

    def __post_init__(self) -> None:
        _lengths("rod", self, ("radius", "top"))


@dataclass(frozen=True)
class Lid:
    """A cone from the hopper's rim up to `inner_radius`, `height` above the rim."""

    inner_radius: float
    height: float

    def __post_init__(self) -> None:
        _lengths("lid", self, ("inner_radius", "height"))


@dataclass(frozen=True)
class Hatch:
    """The lid's opening: in plan a rectangle, `length` in x and `width` in y, about its centre."""

    centre_across: float
    centre_along: float
    length: float
    width: float

    def __post_init__(self) -> None:
        _places("hatch", self, ("centre_across", "centre_along"))
        _lengths("hatch", self, ("length", "width"))

    @property
    def lower(self) -> tuple[float, float]:
        """Least x and y, m."""
        return self.centre_across - 0.5 * self.length, self.centre_along - 0.5 * self.width

    @property
    def upper(self) -> tuple[float, float]:
        """Largest x and y, m."""
        return self.centre_across + 0.5 * self.length, self.centre_along + 0.5 * self.width


@dataclass(frozen=True)
class Deflector:
    """A two-skew roof under the hatch: from a level ridge two plane faces fall away, one towards the belt (near)
    and one away from it (far).

    ridge_across, ridge_along   x and y of the ridge's middle; ridge_height its z, m
    near_pitch_deg, far_pitch_deg   of the faces, from the horizontal
    rotation_deg                of the ridge about z; 0: along the drum's axis
    edge_length                 of the ridge; face_length: of a face down its slope, m
    """

    near_pitch_deg: float
    far_pitch_deg: float
    ridge_across: float
    ridge_along: float
    ridge_height: float
    rotation_deg: float
    edge_length: float
    face_length: float

    def __post_init__(self) -> None:
        within("deflector.near_pitch_deg", self.near_pitch_deg, 0.0, 89.0, "degrees")
        within("deflector.far_pitch_deg", self.far_pitch_deg, 0.0, 89.0, "degrees")
        within("deflector.rotation_deg", self.rotation_deg, -180.0, 180.0, "degrees")
        _places("deflector", self, ("ridge_across", "ridge_along", "ridge_height"))
        _lengths("deflector", self, ("edge_length", "face_length"))


@dataclass(frozen=True)
class Belt:
    """A troughed belt on three rollers that rises by `tilt_deg` to its drive drum.

    drum_height, drum_across, drum_along   how far the drum's centre lies above the reference point, before it
                       across the drum's axis, and beside it along the axis (the belt comes from -x, at -y)
    drum_diameter      without the belt; thickness: of the belt on it
    width              of the belt, a third on each roller; trough_deg: how far the outer rollers are raised
    transition_length  on which the trough flattens out towards the drum
    loaded_length      of belt that is modelled, from the drum's top backwards
    """

    drum_height: float
    drum_across: float
    drum_along: float
    drum_diameter: float
    thickness: float
    speed: float
    tilt_deg: float
    rollers: int
    width: float
    trough_deg: float
    transition_length: float
    loaded_length: float

    def __post_init__(self) -> None:
        _places("belt", self, ("drum_height", "drum_across", "drum_along"))
        names = ("drum_diameter", "thickness", "width", "transition_length", "loaded_length")
        _lengths("belt", self, names)
        positive("belt.speed", self.speed, "m/s")
        within("belt.speed", self.speed, 0.01, 20.0, "m/s")
        within("belt.tilt_deg", self.tilt_deg, -30.0, 30.0, "degrees")
        within("belt.trough_deg", self.trough_deg, 0.0, 60.0, "degrees")
        if self.rollers != 3:
            raise InputError("belt.rollers", self.rollers, "3: other troughs come as an STL")
        if self.transition_length >= self.loaded_length:
            allowed = f"less than the loaded length, {self.loaded_length:g} m"
            raise InputError("belt.transition_length", self.transition_length, allowed)

    @property
    def outer_radius(self) -> float:
        """Of the belt's surface on the drum, m."""
        return 0.5 * self.drum_diameter + self.thickness

    @property
    def drum_centre(self) -> tuple[float, float, float]:
        return -self.drum_across, -self.drum_along, self.drum_height

    @property
    def running(self) -> tuple[float, float, float]:
        """Unit vector the way the belt runs."""
        tilt = math.radians(self.tilt_deg)
        return math.cos(tilt), 0.0, math.sin(tilt)

    @property
    def normal(self) -> tuple[float, float, float]:
        """Unit vector up from the belt's middle strip."""
        tilt = math.radians(self.tilt_deg)
        return -math.sin(tilt), 0.0, math.cos(tilt)

    @property
    def tangent_point(self) -> tuple[float, float, float]:
        """Where the belt's middle meets the drum: its tilt before the drum's top."""
        x, y, z = (c + self.outer_radius * n for c, n in zip(self.drum_centre, self.normal, strict=True))
        return x, y, z

    @property
    def ride_seconds(self) -> float:
        """Time that the modelled belt takes from its tail to the drum, s."""
        return self.loaded_length / self.speed


@dataclass(frozen=True)
class Feeder:
    """Where material comes onto the belt's tail: a level rectangle, `length` along the belt and `width` across,
    `drop` above the belt at its middle; it comes with the belt's speed and falls with `fall_speed`. Skirtboards
    stand on both edges of the belt from its tail on, `skirt_length` long and `skirt_height` high."""

    length: float
    width: float
    drop: float
    fall_speed: float
    skirt_length: float
    skirt_height: float

    def __post_init__(self) -> None:
        _lengths("feeder", self, ("length", "width", "drop", "skirt_length", "skirt_height"))
        within("feeder.fall_speed", self.fall_speed, 0.0, 10.0, "m/s")


@dataclass(frozen=True, eq=False)
class Replacement:
    """A mesh, in the plant's frame, that stands for `part`; `file` says where it came from."""

    part: str
    mesh: TriangleMesh
    file: str


@dataclass(frozen=True)
class Plant:
    """All parts. `head_room` is the share of a charge's loose volume that the hopper must hold besides it;
    `replacements` stand for parts of the same name; `sources` says of every number where it comes from."""

    hopper: Hopper
    bell: Bell
    rod: Rod
    lid: Lid
    hatch: Hatch
    deflector: Deflector
    belt: Belt
    feeder: Feeder
    head_room: float
    replacements: tuple[Replacement, ...] = ()
    sources: tuple[tuple[str, str], ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        within("plant.head_room", self.head_room, 0.0, 10.0)
        straight = self.belt.loaded_length - self.belt.transition_length
        if self.feeder.skirt_length > straight:
            allowed = f"at most {straight:g} m: there the trough begins to flatten"
            raise InputError("feeder.skirt_length", self.feeder.skirt_length, allowed)
        names = [r.part for r in self.replacements]
        for name in names:
            if name not in REPLACEABLE or names.count(name) > 1:
                raise InputError("plant.replacements", name, "each once, of " + ", ".join(REPLACEABLE))
        if self.rod.radius >= min(self.lid.inner_radius, self.hopper.seat_radius):
            allowed = "thinner than the lid's opening and the bell's seat"
            raise InputError("rod.radius", self.rod.radius, allowed)
        if self.lid.inner_radius >= self.hopper.rim_radius:
            raise InputError("lid.inner_radius", self.lid.inner_radius, "less than the hopper's rim")
        if self.bell_top >= 0.0:
            allowed = f"a bell below the rim: this one rises to {self.bell_top:g} m"
            raise InputError("bell.slope_deg", self.bell.slope_deg, allowed)

    @property
    def bell_height(self) -> float:
        """From the seat to where the bell meets the rod, m."""
        return (self.hopper.seat_radius - self.rod.radius) * math.tan(math.radians(self.bell.slope_deg))

    @property
    def bell_top(self) -> float:
        """z where the bell meets the rod, m."""
        return self.bell_height - self.hopper.seat_depth

    def replacement(self, part: str) -> Replacement | None:
        """The mesh that stands for a part; None where the part's own numbers do."""
        return next((r for r in self.replacements if r.part == part), None)

    def floor_at(self, radius: float) -> float:
        """z of the hopper's inside, bell or wall, at this distance from the axis, m."""
        h = self.hopper
        if radius <= h.seat_radius:
            rise = (h.seat_radius - radius) * math.tan(math.radians(self.bell.slope_deg))
            return min(rise, self.bell_height) - h.seat_depth
        if radius >= h.rim_radius:
            return 0.0
        return -h.seat_depth + h.cone_height * (radius - h.seat_radius) / (h.rim_radius - h.seat_radius)

    def lid_at(self, radius: float) -> float:
        """z of the lid at this distance from the axis, m."""
        rim, inner = self.hopper.rim_radius, self.lid.inner_radius
        return self.lid.height * min(max((rim - radius) / (rim - inner), 0.0), 1.0)


REPLACEABLE = ("hopper", "bell", "rod", "lid", "deflector", "belt")
PARTS = tuple(f.name for f in fields(Plant))[:8]

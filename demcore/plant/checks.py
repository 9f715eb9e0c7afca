"""Whether a plant can be charged at all, in closed form where there is one: each refusal is a sentence.

Notation: a, b radii of a frustum's ends, h its height, m: its volume is pi h (a^2 + a b + b^2) / 3.
"""

from __future__ import annotations

import math

from demcore.errors import InputError
from demcore.plant.jet import crossing
from demcore.plant.parts import Plant
from demcore.plant.surfaces import deflector_mesh


def frustum(height: float, a: float, b: float) -> float:
    """Volume of a cone frustum, m3."""
    return math.pi * height * (a * a + a * b + b * b) / 3.0


def capacity(plant: Plant) -> float:
    """m3 inside the hopper below its rim: cylinder and cone, less bell and rod."""
    h, rod = plant.hopper, plant.rod.radius
    inside = frustum(h.cylinder_height, h.rim_radius, h.rim_radius)
    inside += frustum(h.cone_height, h.rim_radius, h.seat_radius)
    bell = frustum(plant.bell_height, h.seat_radius, rod)
    return inside - bell - frustum(-plant.bell_top, rod, rod)


def level_volume(plant: Plant, z: float) -> float:
    """m3 inside the hopper below the level z, m."""
    h, rod = plant.hopper, plant.rod.radius
    z = min(max(z, -h.seat_depth), 0.0)
    up = z + h.seat_depth
    cone = min(up, h.cone_height)
    inside = frustum(cone, h.seat_radius, h.radius_at(z))
    inside += frustum(max(up - h.cone_height, 0.0), h.rim_radius, h.rim_radius)
    bell = min(up, plant.bell_height)
    top = h.seat_radius - (h.seat_radius - rod) * bell / plant.bell_height
    return inside - frustum(bell, h.seat_radius, top) - frustum(max(z - plant.bell_top, 0.0), rod, rod)


def level_of(plant: Plant, volume: float) -> float:
    """z up to which so many m3 fill the hopper level, m; the rim's when they do not fit."""
    low, high = -plant.hopper.seat_depth, 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if level_volume(plant, middle) < volume else (low, middle)
    return high


def check_mass(plant: Plant, mass: float, bulk_density: float) -> None:
    """Raises InputError for a charge (kg at kg/m3) that the hopper does not hold with its head room."""
    room = capacity(plant)
    needed = mass / bulk_density * (1.0 + plant.head_room)
    if needed > room:
        allowed = (
            f"at most {room * bulk_density / (1.0 + plant.head_room):.0f} kg: the hopper holds {room:.2f} m3, and "
            f"{mass:.0f} kg at {bulk_density:.0f} kg/m3 with {plant.head_room:.0%} head room need {needed:.2f} m3"
        )
        raise InputError("charge.mass", round(mass, 3), allowed)


def check_plant(plant: Plant) -> None:
    """Raises InputError for parts that do not fit together, and for a belt that misses the hatch."""
    _check_drum(plant)
    if plant.replacement("lid") is None:
        _check_hatch(plant)
        _check_jet(plant)
    if plant.replacement("deflector") is None and plant.replacement("hopper") is None:
        check_deflector(plant)


def _check_hatch(plant: Plant) -> None:
    (x0, y0), (x1, y1) = plant.hatch.lower, plant.hatch.upper
    corner = max(math.hypot(x, y) for x in (x0, x1) for y in (y0, y1))
    if corner >= plant.hopper.rim_radius:
        allowed = (
            f"an opening inside the rim of {plant.hopper.rim_radius:g} m; its corner lies {corner:.3f} m out"
        )
        raise InputError("hatch.length", plant.hatch.length, allowed)
    nearest = math.hypot(min(max(x0, 0.0), x1), min(max(y0, 0.0), y1))
    if nearest <= plant.lid.inner_radius:
        allowed = f"an opening clear of the rod's passage, {plant.lid.inner_radius:g} m from the axis"
        raise InputError("hatch.width", plant.hatch.width, allowed)


def _check_jet(plant: Plant) -> None:
    x, y, z = crossing(plant)
    (x0, y0), (x1, y1) = plant.hatch.lower, plant.hatch.upper
    if not (x0 <= x <= x1 and y0 <= y <= y1):
        allowed = (
            f"a jet through the hatch, x {x0:.3f} to {x1:.3f} m and y {y0:.3f} to {y1:.3f} m; at this speed it "
            f"comes down on the lid at x {x:.3f} m, y {y:.3f} m, z {z:.3f} m"
        )
        raise InputError("belt.speed", plant.belt.speed, allowed)


def _check_drum(plant: Plant) -> None:
    lowest = plant.belt.drum_height - plant.belt.outer_radius
    if lowest <= plant.lid.height:
        top = f"{plant.lid.height:g} m high"
        allowed = f"a drum clear of the lid, which is {top}; its underside is at {lowest:.3f} m"
        raise InputError("belt.drum_height", plant.belt.drum_height, allowed)


def check_deflector(plant: Plant) -> None:
    """Its corners lie inside the hopper: below the lid, above the floor, within the wall, clear of the rod."""
    for x, y, z in deflector_mesh(plant.deflector).vertices:
        radius, told = math.hypot(x, y), f"the corner at x {x:.3f} m, y {y:.3f} m, z {z:.3f} m"
        if radius >= plant.hopper.rim_radius or z >= plant.lid_at(radius):
            raise InputError("deflector", told, "inside the hopper, below its lid")
        if radius <= plant.rod.radius or z <= plant.floor_at(radius):
            raise InputError("deflector", told, "clear of the rod, above the bell and the hopper's wall")

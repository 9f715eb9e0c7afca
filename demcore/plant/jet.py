"""The jet that a belt throws off its drum, in closed form: what a case is checked against before it is run.

Notation: R radius of the path, m; v speed on it, m/s; phi angle past the drum's top; h height above the belt, m.
A grain that rides the drum leaves where gravity no longer holds it, g R cos phi = v^2 (physics.md section 3:
32.4 degrees at 1.79 m/s and R = .387 m), or at once, where the belt meets the drum, when it is faster than that.
After that it follows a parabola. The air is left out: the paper's section 3.1 finds its drag negligible. A layer
at height h that turns with the drum is faster, v = W (R + h): the usual upper bound of a thick bed's throw.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from demcore.plant.parts import Belt, Plant

GRAVITY = 9.81


class Release(NamedTuple):
    """Where and how a grain leaves the drum: angle past the top, degrees; x, z, m; velocity, m/s."""

    angle_deg: float
    x: float
    z: float
    vx: float
    vz: float


def release(belt: Belt, height: float = 0.0) -> Release:
    """Of a grain that turns with the drum at `height` above the belt, m."""
    radius = belt.outer_radius + height
    speed = belt.speed * radius / belt.outer_radius
    tilt = math.radians(belt.tilt_deg)
    held = speed**2 / (GRAVITY * radius)
    phi = -tilt if held >= math.cos(tilt) else math.acos(held)
    x, _, z = belt.drum_centre
    return Release(
        math.degrees(phi),
        x + radius * math.sin(phi),
        z + radius * math.cos(phi),
        speed * math.cos(phi),
        -speed * math.sin(phi),
    )


def position(start: Release, time: float) -> tuple[float, float]:
    """x and z, m, so long after the release (s)."""
    return start.x + start.vx * time, start.z + start.vz * time - 0.5 * GRAVITY * time * time


def fall_time(start: Release, z: float) -> float:
    """s, from the release until the grain falls through height z; nan above the jet's top."""
    inside = start.vz**2 + 2.0 * GRAVITY * (start.z - z)
    return math.nan if inside < 0.0 else (start.vz + math.sqrt(inside)) / GRAVITY


def x_at(start: Release, z: float) -> float:
    """x at which the jet falls through height z, m."""
    return position(start, fall_time(start, z))[0]


def crossing(plant: Plant, height: float = 0.0) -> tuple[float, float, float]:
    """Where the jet's middle goes through the lid's surface, or the plane of the rim beyond it: x, y, z, m."""
    start, y = release(plant.belt, height), plant.belt.drum_centre[1]

    def above(time: float) -> float:
        x, z = position(start, time)
        return z - plant.lid_at(math.hypot(x, y))

    time = _root(above, fall_time(start, 0.0))
    x, z = position(start, time)
    return x, y, z


def _root(f: Callable[[float], float], last: float) -> float:
    """The first time at which f is no longer positive, s; f is at `last`."""
    steps = 2000
    high = next((last * k / steps for k in range(1, steps + 1) if f(last * k / steps) <= 0.0), last)
    low = max(high - last / steps, 0.0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if f(middle) > 0.0 else (low, middle)
    return high

"""What is stored of a particle, unrounded: one of them for the reader who picked it, or all as a table."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from service.scene.sphere_file import Spheres

# By VTK's name: what the table's columns and the answer's keys are called, one name a component.
NAMES = {
    "Velocity": ("velocity_x_m_s", "velocity_y_m_s", "velocity_z_m_s"),
    "AngularVelocity": ("spin_x_rad_s", "spin_y_rad_s", "spin_z_rad_s"),
    "Number": ("number",),
    "Material": ("material",),
    "Place": ("place",),
}
POSITION = ("x_m", "y_m", "z_m")
ROWS_AT_ONCE = 4096


def describe_grain(spheres: Spheres, row: int) -> dict[str, float | int | None]:
    """Every stored number of one particle, by name with its unit. Raises IndexError where there is no such row."""
    if not 0 <= row < len(spheres.radii):
        raise IndexError(row)
    found: dict[str, float | int | None] = {"row": row}
    for name, values in _columns(spheres):
        value = values[row].item()
        found[name] = value if math.isfinite(value) else None
    return found


def write_table(spheres: Spheres) -> Iterator[str]:
    """All particles as CSV (RFC 4180), some thousand lines at a time."""
    columns = _columns(spheres)
    yield ",".join(name for name, _ in columns) + "\r\n"
    for first in range(0, len(spheres.radii), ROWS_AT_ONCE):
        block = [values[first : first + ROWS_AT_ONCE].tolist() for _, values in columns]
        yield "".join(",".join(map(_cell, row)) + "\r\n" for row in zip(*block, strict=True))


def _cell(value: float | int) -> str:
    return str(value) if isinstance(value, int) else f"{value:.9g}" if math.isfinite(value) else ""


def _columns(spheres: Spheres) -> list[tuple[str, Any]]:
    stored = [field for field in ("Number", "Material", "Place") if field in spheres.data]
    found: list[tuple[str, Any]] = [(NAMES[field][0], spheres.data[field]) for field in stored]
    found += zip(POSITION, spheres.positions.T, strict=True)
    found.append(("diameter_mm", 2000.0 * spheres.radii))
    speeds = spheres.speeds
    if speeds is not None:
        found.append(("speed_m_s", speeds))
    for field in ("Velocity", "AngularVelocity"):
        if field in spheres.data:
            found += zip(NAMES[field], np.asarray(spheres.data[field], float).T, strict=True)
    return found

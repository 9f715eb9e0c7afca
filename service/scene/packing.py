"""Particles and walls as few bytes for the pages' viewer: 8 bytes a sphere, rounded to what a screen can show.

Exact numbers are asked for one particle at a time or as a table (exact.py); these are for drawing alone.

Layout: MAGIC (4 bytes), length of the header (u32, little endian), the header (JSON in ASCII, padded with blanks
so that what follows begins at a multiple of 8), then the arrays one after the other, little endian.

    frame   N x (x, y, z: u16, shares of the box from `low` to `high`; radius: u8, share of `radius`; material: u8)
    column  N x u8, shares (of 254) of `range`; UNKNOWN where there is no value
    walls   P x (x, y, z: f32), then T x 3 x u32; `groups` say which triangles are which wall
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.scene.sphere_file import Floats, Spheres, Surface

MAGIC = b"TLS1"
PLACE_LEVELS, RADIUS_LEVELS, VALUE_LEVELS = 65535, 255, 254
UNKNOWN = 255
MEDIA_TYPE = "application/octet-stream"

SPHERE = np.dtype([("place", "<u2", 3), ("radius", "u1"), ("material", "u1")])


def pack_frame(spheres: Spheres) -> bytes:
    """The frame for drawing."""
    low, high = _bounds(spheres.positions)
    smallest, largest = _range(spheres.radii)
    rows = np.empty(len(spheres.radii), SPHERE)
    rows["place"] = _levels(spheres.positions, low, high, PLACE_LEVELS)
    rows["radius"] = _levels(spheres.radii, smallest, largest, RADIUS_LEVELS)
    rows["material"] = np.clip(spheres.data.get("Material", 0), 0, 255)
    header = {
        "grains": len(rows),
        "time_s": spheres.time_s,
        "low": low.tolist(),
        "high": high.tolist(),
        "radius": [smallest, largest],
    }
    return _joined(header, rows.tobytes())


def pack_column(values: Floats) -> bytes:
    """A number of each particle for colours; NaN is not known."""
    low, high = _range(values[np.isfinite(values)])
    known = np.isfinite(values)
    levels = np.full(len(values), UNKNOWN, np.uint8)
    levels[known] = _levels(values[known], low, high, VALUE_LEVELS)
    return _joined({"grains": len(values), "range": [low, high]}, levels.tobytes())


def pack_walls(surface: Surface, solid: Sequence[int] = ()) -> bytes:
    """Triangles in the order of their walls; those of `solid` are drawn as bodies, the others as glass."""
    order = np.argsort(surface.walls, kind="stable")
    names, firsts = np.unique(surface.walls[order], return_index=True)
    ends = [*firsts[1:].tolist(), len(order)]
    groups = [
        {"wall": int(name), "first": int(first), "count": int(end - first), "solid": int(name) in solid}
        for name, first, end in zip(names, firsts, ends, strict=True)
    ]
    low, high = _bounds(surface.points)
    header: dict[str, Any] = {
        "points": len(surface.points),
        "triangles": len(order),
        "groups": groups,
        "low": low.tolist(),
        "high": high.tolist(),
    }
    places, corners = surface.points.astype("<f4"), surface.triangles[order].astype("<u4")
    return _joined(header, places.tobytes() + corners.tobytes())


def _bounds(points: Floats) -> tuple[Floats, Floats]:
    if len(points) == 0:
        return np.zeros(3), np.zeros(3)
    return points.min(axis=0), points.max(axis=0)


def _range(values: Floats) -> tuple[float, float]:
    return (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)


def _levels(values: Floats, low: Any, high: Any, levels: int) -> NDArray[np.int64]:
    """Nearest of 0 to `levels`; where all values are one, 0."""
    width = np.asarray(high, float) - np.asarray(low, float)
    shares = (values - low) / np.where(width > 0.0, width, 1.0)
    return np.asarray(np.rint(shares * levels), np.int64)


def _joined(header: Mapping[str, Any], body: bytes) -> bytes:
    text = json.dumps(header, allow_nan=False).encode("ascii")
    text += b" " * (-len(text) % 8)
    return MAGIC + len(text).to_bytes(4, "little") + text + body

"""Walls as the kernels read them: one row per wall and array, one rigid pose per wall.

Notation: body frame: origin at the wall's centre, z along its axis; world = centre + rotation q, rotation row by
row. Every wall is evaluated in its body frame, so that all of them travel and turn truly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.geometry.motion import place_all
from demcore.geometry.triangle_tree import build_tree, morton_order
from demcore.geometry.wall_rows import PLANE, REVOLUTION, TRIANGLES, Walls
from demcore.geometry.walls import Oscillation, Wall

Floats = NDArray[np.float64]


class _Mesh(NamedTuple):
    triangles: Floats
    boxes: Floats


def frame(axis: Sequence[float]) -> Floats:
    """(3, 3) rotation that takes z to the axis: columns are two normals of it and the axis itself."""
    z = np.array(axis, float)
    z /= math.hypot(*z)
    # The world direction farthest from the axis, so that an upright wall gets exactly the identity.
    x = np.eye(3)[0] if abs(z[0]) <= 0.9 else np.eye(3)[1]
    x = x - (x @ z) * z
    x /= math.hypot(*x)
    return np.column_stack([x, np.cross(z, x), z])


def _rotation(wall: Wall) -> Floats:
    return np.eye(3) if wall.kind == "mesh" else frame(wall.axis)


def _profile(wall: Wall) -> tuple[float, float, float, float]:
    """Start radius, unit direction and length of the segment that turns about the axis; see surfaces.py."""
    if wall.kind == "disc":
        return wall.inner_radius, 1.0, 0.0, wall.radius - wall.inner_radius
    if wall.kind == "cylinder":
        return wall.radius, 0.0, 1.0, wall.length
    if wall.kind == "cone":
        away = wall.end_radius - wall.radius
        slant = math.hypot(away, wall.length)
        return wall.radius, away / slant, wall.length / slant, slant
    return 0.0, 0.0, 0.0, 0.0


def _oscillation(wall: Wall) -> Oscillation:
    return wall.oscillation or Oscillation()


def _turns_in_place(wall: Wall, offset: Floats) -> bool:
    """True when its turning moves no point of space into the wall: a body of revolution about its own axis."""
    if wall.kind == "mesh":
        return False
    axis = frame(wall.axis)[:, 2]
    turns = [np.array(wall.angular_velocity, float)]
    if _oscillation(wall).angle:
        turns.append(np.array(_oscillation(wall).axis, float))
    turns = [t for t in turns if t.any()]
    along = all(np.abs(np.cross(t, axis)).max() <= 1e-14 * np.abs(t).max() for t in turns)
    if not turns:
        return True
    # A plane has its axis everywhere; the others only through their centre.
    on_axis = wall.kind == "plane" or np.abs(np.cross(offset, axis)).max() <= 1e-14 * np.abs(offset).max()
    return bool(along and on_axis)


def _extent(wall: Wall, offset: Floats) -> float:
    """Farthest point of the surface from the pivot that a turn moves, m; 0 when none moves."""
    if _turns_in_place(wall, offset):
        return 0.0
    if wall.mesh is not None:
        points = wall.mesh.vertices + offset
        return float(np.sqrt((points**2).sum(axis=1).max()))
    if wall.kind == "plane":
        return math.inf
    return math.hypot(*offset) + math.hypot(max(wall.radius, wall.end_radius), wall.length)


def _mesh(wall: Wall) -> _Mesh:
    """Triangles in the order of their tree, and the tree."""
    if wall.mesh is None:
        return _Mesh(np.zeros((0, 12)), np.zeros((0, 6)))
    corners = wall.mesh.corners()
    order = morton_order(corners)
    rows = np.hstack([corners[order].reshape(-1, 9), wall.mesh.normals()[order]])
    return _Mesh(rows, build_tree(corners[order]))


def _offset(wall: Wall) -> Floats:
    pivot = wall.centre if wall.pivot is None else wall.pivot
    return np.subtract(wall.centre, pivot, dtype=float)


def _shape_row(wall: Wall) -> list[float]:
    speed = math.hypot(*wall.surface_velocity)
    belt = np.array(wall.surface_velocity, float) / speed if speed > 0.0 else np.zeros(3)
    return [*_profile(wall), *(_rotation(wall).T @ belt), speed, _extent(wall, _offset(wall))]


def _rest_row(wall: Wall) -> list[float]:
    offset = _offset(wall)
    return [*(np.array(wall.centre, float) - offset), *offset, *_rotation(wall).ravel()]


def _motion_row(wall: Wall) -> list[float]:
    o = _oscillation(wall)
    axis = np.array(o.axis, float) / math.hypot(*o.axis)
    return [
        *wall.velocity,
        *wall.angular_velocity,
        *o.amplitude,
        o.frequency,
        o.phase,
        o.angle,
        *axis,
        wall.moves_from,
        wall.moves_until,
    ]


def _kind(wall: Wall) -> int:
    return {"plane": PLANE, "mesh": TRIANGLES}.get(wall.kind, REVOLUTION)


def _starts(pieces: list[Floats]) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum([len(p) for p in pieces])]).astype(np.int64)


def wall_arrays(walls: Sequence[Wall], time: float = 0.0) -> Walls:
    """Walls in order, standing where they are at `time`, s."""

    def rows(make: Any, width: int) -> Floats:
        return np.array([make(w) for w in walls], np.float64).reshape(len(walls), width)

    meshes = [_mesh(w) for w in walls]
    triangles, boxes = [m.triangles for m in meshes], [m.boxes for m in meshes]
    new = Walls(
        kind=np.array([_kind(w) for w in walls], np.int64),
        material=np.array([w.material for w in walls], np.int64),
        window=rows(lambda w: (w.from_time, w.until_time), 2),
        shape=rows(_shape_row, 9),
        rest=rows(_rest_row, 15),
        motion=rows(_motion_row, 17),
        pose=np.zeros((len(walls), 21)),
        home=np.zeros((len(walls), 13)),
        triangle=np.concatenate([np.zeros((0, 12)), *triangles]),
        first_triangle=_starts(triangles),
        box=np.concatenate([np.zeros((0, 6)), *boxes]),
        first_box=_starts(boxes),
    )
    place_all(new, time)
    return new


def replace_wall(walls: Walls, index: int, wall: Wall, time: float) -> None:
    """Another motion, belt, material or lifetime for wall `index` from `time`, s, on. Its number and kind of
    shape stay, so that contacts keep their histories; take a new neighbour list after it (Simulation.stale)."""
    alone = wall_arrays([wall])
    for name in ("kind", "material", "window", "shape", "rest", "motion"):
        getattr(walls, name)[index] = getattr(alone, name)[0]
    place_all(walls, time)

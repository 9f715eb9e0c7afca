"""Reads the particles and walls that a run stored: VTKHDF poly data with time (demcore/output/vtkhdf.py).

h5py is imported when the first file is read: the API process starts without it.

Notation: frame k of S is one time step; N particles are in it. Units are SI.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

ROOT = "VTKHDF"


class Unreadable(Exception):
    """A stored file is damaged, or holds no spheres."""


@dataclass(frozen=True)
class Spheres:
    """The particles of one frame: positions (N, 3) m, radii (N,) m and, by VTK's names, whatever else is stored of
    each (`Velocity` (N, 3) m/s, `Material`, `Number`, `Place`, ...)."""

    time_s: float
    positions: Floats
    radii: Floats
    data: Mapping[str, NDArray[Any]]

    @property
    def speeds(self) -> Floats | None:
        """(N,) m/s; None where no velocities are stored."""
        velocity = self.data.get("Velocity")
        return None if velocity is None else np.linalg.norm(velocity, axis=1)


@dataclass(frozen=True)
class Surface:
    """Walls of one frame: points (P, 3) m, triangles (T, 3) as rows of points, wall number (T,)."""

    points: Floats
    triangles: Integers
    walls: Integers


@dataclass(frozen=True)
class Frames:
    """What a file holds: the time of each frame, s, how many particles it has, and the arrays' names."""

    times_s: tuple[float, ...]
    counts: tuple[int, ...]
    fields: frozenset[str]


def list_frames(path: Path) -> Frames:
    """Raises Unreadable."""
    with _opened(path) as root:
        steps = root["Steps"]
        parts = np.asarray(steps["PartOffsets"])
        counts = np.asarray(root["NumberOfPoints"])[parts]
        return Frames(
            tuple(np.asarray(steps["Values"], float).tolist()),
            tuple(counts.tolist()),
            frozenset(root["PointData"]),
        )


def read_spheres(path: Path, k: int) -> Spheres:
    """Frame `k`. Raises Unreadable, and IndexError where there is no such frame."""
    with _opened(path) as root:
        return _spheres(root, k)


def read_surface(path: Path, k: int) -> Surface:
    """The walls of frame `k`. Raises Unreadable, and IndexError where there is no such frame."""
    with _opened(path) as root:
        steps, polygons = root["Steps"], root["Polygons"]
        first, count = _rows(root, k)
        part = int(steps["PartOffsets"][k])
        # Poly data keeps its cells as vertices, lines, polygons and strips, in this order.
        first_cell, first_id = (int(steps[n][k, 2]) for n in ("CellOffsets", "ConnectivityIdOffsets"))
        ids = int(polygons["NumberOfConnectivityIds"][part])
        if ids % 3:
            raise Unreadable(f"{path.name} holds walls that are not triangles")
        corners = np.asarray(polygons["Connectivity"][first_id : first_id + ids], np.int64).reshape(-1, 3)
        numbers = root["CellData"]["Wall"][first_cell : first_cell + len(corners)]
        points = np.asarray(root["Points"][first : first + count], float)
        return Surface(points, corners, np.asarray(numbers, np.int64))


@lru_cache(maxsize=4)
def read_arrivals(path: Path, level_m: float) -> Floats:
    """When each particle was first seen below z = `level_m`, s, in the row of its number; not yet: NaN.

    A frame tells no more than that it came since the one before. Raises Unreadable.
    """
    with _opened(path) as root:
        if "Number" not in root["PointData"]:
            raise Unreadable(f"{path.name} does not number its particles")
        steps = root["Steps"]
        found = np.full(1 + int(np.max(root["PointData"]["Number"], initial=0)), np.nan)
        for k, time in enumerate(np.asarray(steps["Values"], float)):
            first, count = _rows(root, k)
            below = root["Points"][first : first + count, 2] < level_m
            start = int(steps["PointDataOffsets"]["Number"][k])
            numbers = np.asarray(root["PointData"]["Number"][start : start + count], np.int64)[below]
            found[numbers[np.isnan(found[numbers])]] = time
        found.flags.writeable = False
        return found


def _spheres(root: Any, k: int) -> Spheres:
    steps = root["Steps"]
    first, count = _rows(root, k)
    data = {}
    for name, array in root["PointData"].items():
        start = int(steps["PointDataOffsets"][name][k])
        data[name] = np.asarray(array[start : start + count])
    return Spheres(
        float(steps["Values"][k]),
        np.asarray(root["Points"][first : first + count], float),
        np.asarray(data.pop("Radius"), float),
        data,
    )


def _rows(root: Any, k: int) -> tuple[int, int]:
    """First row and number of points of frame `k`, which must be one part."""
    steps = root["Steps"]
    if not 0 <= k < len(steps["Values"]):
        raise IndexError(k)
    return int(steps["PointOffsets"][k]), int(root["NumberOfPoints"][int(steps["PartOffsets"][k])])


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    import h5py

    try:
        with h5py.File(path, "r", locking=False) as file:
            yield file[ROOT]
    except (OSError, KeyError) as error:
        raise Unreadable(f"the stored file cannot be read ({error})") from error

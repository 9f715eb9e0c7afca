"""A run as time series for ParaView: spheres.vtkhdf and walls.vtkhdf, written while it runs.

Two files rather than one with two blocks, so that each opens as plain poly data with time. While the run goes on
they are called NAME.running.vtkhdf and may be opened; at its end they get their names. A run that was killed and
goes on leaves the files that it would have left without.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from demcore.errors import InputError
from demcore.geometry.motion import is_present
from demcore.geometry.wall_rows import CENTRE, PLANE, PROFILE, TRIANGLES, TURN, Walls
from demcore.output.frames import Arrays, FrameJournal
from demcore.output.spheres import SPHERE_FIELDS, vertices
from demcore.output.tessellation import revolution, square
from demcore.output.vtkhdf import Field, PolyData, PolyDataSeries, replace_file
from demcore.particles import VX, VZ, WX, WZ, R, X, Z
from demcore.simulation import Simulation

WALL_FIELDS = (Field("Wall", "i4"), Field("Material", "i4"))
JOURNAL = "series.journal"
SPHERES, WALLS = "spheres", "walls"
WALL_ARRAYS = ("wall_points", "wall_triangles", "wall_number", "wall_material")


class SeriesRecorder:
    """Records a frame every `interval` s of simulated time into `folder`; see `demcore.run.Recorder`.

    Raises InputError for an interval that is not positive.
    """

    def __init__(self, folder: Path, interval: float) -> None:
        if not 0.0 < interval < np.inf:
            raise InputError("frame_interval", interval, "a positive time in s")
        self.folder, self.interval = folder, interval
        self._journal = FrameJournal(folder / JOURNAL)
        self._series: dict[str, PolyDataSeries] = {}
        self._time = -np.inf
        self._patch: NDArray[np.float64] | None = None
        self._walls: Arrays = {}

    def frame(self, time: float, simulation: Simulation) -> None:
        """Write the state at `time`, s; a frame of that time or later that is there is written anew."""
        if not self._series:
            self._journal.discard()
            self._open()
        elif time <= self._time:
            self.rewind(np.nextafter(time, -np.inf))
        if self._patch is None:
            self._patch = _patch_of(simulation)
        arrays = sphere_arrays(simulation) | {"patch": self._patch}
        walls = wall_arrays_of(simulation.walls, self._patch, simulation.step, simulation.dt)
        if not self._walls or any(not np.array_equal(walls[name], self._walls[name]) for name in walls):
            arrays |= walls
        self._journal.append(time, arrays)
        self._show(time, arrays)

    def rewind(self, time: float) -> None:
        """Forget all frames later than `time`, s, and make the files anew from those before."""
        self._journal.cut(time)
        self._open()
        for at, arrays in self._journal.frames():
            self._show(at, arrays)

    def finish(self) -> None:
        """Give the files their names; nothing more can be recorded.

        The journal stays until `discard_journal`, to be called once no checkpoint asks to go on from.
        """
        for name, series in self._series.items():
            series.close()
            replace_file(self._running(name), self.folder / f"{name}.vtkhdf")
        self._series = {}

    def discard_journal(self) -> None:
        self._journal.discard()

    def close(self) -> None:
        """Let go of the files of a run that stops here and may go on later."""
        for series in self._series.values():
            series.close()
        self._series = {}

    def _open(self) -> None:
        self.close()
        self._time, self._patch, self._walls = -np.inf, None, {}
        self._series = {
            SPHERES: PolyDataSeries(self._running(SPHERES), "Vertices", SPHERE_FIELDS),
            WALLS: PolyDataSeries(self._running(WALLS), "Polygons", (), WALL_FIELDS),
        }

    def _running(self, name: str) -> Path:
        return self.folder / f"{name}.running.vtkhdf"

    def _show(self, time: float, arrays: Arrays) -> None:
        points = arrays["Points"]
        data = {field.name: arrays[field.name] for field in SPHERE_FIELDS}
        self._series[SPHERES].append(time, PolyData(points, vertices(len(points)), data, {}))
        if WALL_ARRAYS[0] in arrays:
            self._walls = {name: arrays[name] for name in WALL_ARRAYS}
            corners, triangles, number, material = self._walls.values()
            cell_data = {"Wall": number, "Material": material}
            self._series[WALLS].append(time, PolyData(corners, triangles, {}, cell_data))
        else:
            self._series[WALLS].repeat(time)
        self._time, self._patch = time, arrays["patch"]


def sphere_arrays(simulation: Simulation) -> Arrays:
    """The particles in the order of their numbers, so that a sphere keeps its row as long as none leaves."""
    p = simulation.particles
    order = np.argsort(p.number, kind="stable")
    state = p.state[order]
    single = np.float32
    return {
        "Points": state[:, X : Z + 1].astype(single),
        "Radius": state[:, R].astype(single),
        "Velocity": state[:, VX : VZ + 1].astype(single),
        "AngularVelocity": state[:, WX : WZ + 1].astype(single),
        "Material": p.material[order].astype(np.int32),
        "Number": p.number[order].astype(np.int64),
    }


def _patch_of(simulation: Simulation) -> NDArray[np.float64]:
    """Centre and half side, m, of the patch that planes are cut to: twice what the particles take up at first."""
    position = simulation.particles.state[:, X : Z + 1]
    if len(position) == 0:
        return np.array([0.0, 0.0, 0.0, 1.0])
    lowest, highest = position.min(axis=0), position.max(axis=0)
    half = float((highest - lowest).max()) + 2.0 * float(simulation.particles.state[:, R].max())
    return np.array([*(0.5 * (lowest + highest)), half])


def wall_arrays_of(walls: Walls, patch: NDArray[np.float64], step: int, dt: float) -> Arrays:
    """All walls that are there at this step as triangles; `Wall` is their row, planes are cut to the patch."""
    points, triangles, number, material = [], [], [], []
    count = 0
    for w in range(len(walls.kind)):
        if not is_present(walls, w, step, dt):
            continue
        corners, faces = _surface(walls, w, patch)
        points.append(corners)
        triangles.append(faces + count)
        number.append(np.full(len(faces), w, np.int32))
        material.append(np.full(len(faces), walls.material[w], np.int32))
        count += len(corners)
    empty: dict[str, NDArray[Any]] = {
        "wall_points": np.zeros((0, 3), np.float32),
        "wall_triangles": np.zeros((0, 3), np.int64),
        "wall_number": np.zeros(0, np.int32),
        "wall_material": np.zeros(0, np.int32),
    }
    if not points:
        return empty
    found = (np.concatenate(points).astype(np.float32), np.concatenate(triangles))
    return dict(zip(empty, (*found, np.concatenate(number), np.concatenate(material)), strict=True))


def _surface(
    walls: Walls, w: int, patch: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    centre, turn = walls.pose[w, CENTRE:TURN], walls.pose[w, TURN : TURN + 9].reshape(3, 3)
    if walls.kind[w] == PLANE:
        points, triangles = square(float(patch[3]))
        # Below the middle of the particles, not wherever on the plane its own centre was put.
        axis = turn[:, 2]
        centre = patch[:3] - ((patch[:3] - centre) @ axis) * axis
    elif walls.kind[w] == TRIANGLES:
        rows = walls.triangle[walls.first_triangle[w] : walls.first_triangle[w + 1], :9]
        points, triangles = rows.reshape(-1, 3), np.arange(3 * len(rows)).reshape(-1, 3)
    else:
        radius, away, up, length = walls.shape[w, PROFILE : PROFILE + 4]
        points, triangles = revolution((radius, 0.0), (radius + length * away, length * up))
    return centre + points @ turn.T, triangles

"""Stored grains: the files of piles and charges as runs leave them, with known places."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from demcore.output.frames import FrameJournal
from demcore.output.spheres import SPHERE_FIELDS, vertices, write_spheres
from demcore.output.tessellation import revolution
from demcore.output.vtkhdf import Field, PolyData, PolyDataSeries
from service.db.session import Database
from service.domain.outcome import StoredArtifact
from service.domain.states import JobKind
from service.scene.journal_file import JOURNAL
from service.settings import Settings
from service.studies.record_measurement import record_measurement
from tests.builders.charges import charges, claimed_charge, finish_charge
from tests.builders.piles import a_pile
from tests.builders.studies import a_study, claimed, designs, open_jobs, propose_next

GRAINS = 60
HDF = "application/x-hdf5"
SPACING_M = 0.02
FRAME_SECONDS = 2.0


def stored(path: Path, kind: str, settings: Settings) -> StoredArtifact:
    """A file moved into the store, under its content's hash."""
    content = path.read_bytes()
    sha256 = hashlib.sha256(content).hexdigest()
    relative = Path(sha256[:2]) / sha256
    (settings.artifacts_dir / relative.parent).mkdir(parents=True, exist_ok=True)
    path.rename(settings.artifacts_dir / relative)
    return StoredArtifact(kind, path.name, HDF, sha256, len(content), relative.as_posix())


def block_of_grains(count: int) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Positions (N, 3) m and radii (N,) m of a cubic block on the plane z = 0, row by row; radii of 4 to 10 mm."""
    side = round(count ** (1 / 3)) + 1
    k = np.arange(count)
    places = np.column_stack([k % side, k // side % side, k // side**2])
    middle = np.array([0.5 * (side - 1), 0.5 * (side - 1), -0.5])
    return SPACING_M * (places - middle), 0.004 + 0.006 * (k % 7) / 6.0


def a_pile_file(folder: Path, count: int = GRAINS) -> Path:
    """As `PileResult.write` leaves it: the end, without numbers. Grain k moves at k mm/s along x."""
    positions, radii = block_of_grains(count)
    velocity = np.zeros((count, 3))
    velocity[:, 0] = 1e-3 * np.arange(count)
    path = folder / "result.vtkhdf"
    data = {"Velocity": velocity, "Material": np.ones(count, np.int32)}
    write_spheres(path, positions, radii, data, {"angle_deg": 25.4})
    return path


def a_series_file(folder: Path, frames: int = 4, count: int = 12) -> Path:
    """As `SeriesRecorder` leaves it: of `count` grains, a share more in each frame, and all of them move down by
    .5 m a frame from z = .6 m on. Grain n of two kinds has the number n + 100."""
    path = folder / "spheres.vtkhdf"
    positions, radii = block_of_grains(count)
    with PolyDataSeries(path, "Vertices", SPHERE_FIELDS) as series:
        for k in range(frames):
            here = count * (k + 1) // frames
            since = k - np.arange(count)[:here] * frames // count
            points = positions[:here] * [1.0, 1.0, 0.0] + np.outer(0.6 - 0.5 * since, [0.0, 0.0, 1.0])
            data = {
                "Radius": radii[:here],
                "Velocity": np.tile([0.0, 0.0, -0.25], (here, 1)),
                "AngularVelocity": np.zeros((here, 3)),
                "Material": 1 + np.arange(here, dtype=np.int32) % 2,
                "Number": 100 + np.arange(here),
            }
            series.append(FRAME_SECONDS * k, PolyData(points, vertices(here), data, {}))
    return path


def a_walls_file(folder: Path, frames: int = 4) -> Path:
    """A cylinder and a cone below it, which stand still."""
    path = folder / "walls.vtkhdf"
    bands = [revolution((1.0, 0.0), (1.0, 1.0)), revolution((1.0, 0.0), (0.2, -0.8))]
    points = np.concatenate([points for points, _ in bands])
    triangles = np.concatenate([bands[0][1], bands[1][1] + len(bands[0][0])])
    wall = np.repeat([0, 1], [len(band[1]) for band in bands]).astype(np.int32)
    fields = (Field("Wall", "i4"), Field("Material", "i4"))
    with PolyDataSeries(path, "Polygons", (), fields) as series:
        data = PolyData(points, triangles, {}, {"Wall": wall, "Material": np.zeros_like(wall)})
        series.append(0.0, data)
        for k in range(1, frames):
            series.repeat(FRAME_SECONDS * k)
    return path


def a_design_with_grains(database: Database, settings: Settings, count: int = GRAINS) -> int:
    """The id of a design whose pile is stored."""
    study_id = a_study(database, parallel=1)
    propose_next(database, study_id)
    (job_id,) = open_jobs(database, study_id, JobKind.SIMULATE)
    settings.artifacts_dir.mkdir(parents=True, exist_ok=True)
    pile = a_pile(25.4, settings)
    file = stored(a_pile_file(settings.artifacts_dir, count), "vtkhdf", settings)
    with database.writing() as session:
        measurement = replace(pile, artifacts=(*pile.artifacts, file))
        assert record_measurement(session, claimed(database, job_id).lease, measurement)
    return designs(database, study_id)[0].id


def leave_files(
    database: Database, settings: Settings, charge_id: int, with_series: bool = True, count: int = 12
) -> None:
    """The charge ends with its `count` grains over time and its walls, or with its last state alone."""
    folder = settings.artifacts_dir
    folder.mkdir(parents=True, exist_ok=True)
    files = (
        (
            stored(a_series_file(folder, count=count), "spheres", settings),
            stored(a_walls_file(folder), "walls", settings),
        )
        if with_series
        else (stored(a_pile_file(folder), "result", settings),)
    )
    finish_charge(database, charge_id, settings, more_files=files)


def a_charge_with_grains(
    database: Database, settings: Settings, with_series: bool = True, count: int = 12
) -> int:
    """The id of a finished charge with its `count` grains over time and its walls, or with neither."""
    (charge_id,) = charges(database)
    leave_files(database, settings, charge_id, with_series, count)
    return charge_id


def write_running_frames(charge_job: str, settings: Settings, frames: int, first: int = 0) -> None:
    """Frames `first` to `frames` of a charge under way, as its recorder journals them: three grains more in each,
    in a cylinder that stands still."""
    folder = settings.series_folder(charge_job)
    folder.mkdir(parents=True, exist_ok=True)
    journal = FrameJournal(folder / JOURNAL)
    points, triangles = revolution((1.0, -0.5), (1.0, 1.0))
    walls = {
        "wall_points": points.astype(np.float32),
        "wall_triangles": triangles,
        "wall_number": np.zeros(len(triangles), np.int32),
        "wall_material": np.zeros(len(triangles), np.int32),
    }
    for k in range(first, frames):
        count = 3 * k
        positions, radii = block_of_grains(max(count, 1))
        grains = {
            "Points": positions[:count].astype(np.float32),
            "Radius": radii[:count].astype(np.float32),
            "Velocity": np.zeros((count, 3), np.float32),
            "AngularVelocity": np.zeros((count, 3), np.float32),
            "Material": np.ones(count, np.int32),
            "Number": np.arange(count),
        }
        journal.append(FRAME_SECONDS * k, grains | (walls if k == 0 else {}))


def a_charge_under_way(database: Database, settings: Settings, frames: int = 3) -> tuple[int, str]:
    """The ids of a charge that a worker simulates, with so many frames so far, and of its job."""
    (charge_id,) = charges(database)
    job_id = claimed_charge(database, charge_id).lease.job_id
    write_running_frames(job_id, settings, frames)
    return charge_id, job_id

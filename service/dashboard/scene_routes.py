"""What the 3D viewer asks for: the scene of a design or charge, frames as few bytes, one grain's exact numbers.

Files are read from the artifact store as the runs left them; a row of the database says which, never the client.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from fastapi import APIRouter, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse

from service.dashboard.pages import database_of, parse_id
from service.dashboard.scene_manifest import (
    RIM_M,
    RUNNING,
    SPHERE_KINDS,
    WALL_KIND,
    Scene,
    base_plate,
    charge_scene,
    pile_scene,
)
from service.db import read_charges, read_models
from service.db.models import ArtifactRow, StudyRow
from service.errors import NotFound
from service.file_store import FileStore, artifact_store
from service.scene.exact import describe_grain, write_table
from service.scene.journal_file import JOURNAL, read_journal_spheres, read_journal_surface
from service.scene.packing import MEDIA_TYPE, pack_column, pack_frame, pack_walls
from service.scene.sphere_file import Floats, Spheres, Unreadable, read_arrivals, read_spheres, read_surface
from service.settings import Settings

router = APIRouter(include_in_schema=False)

T = TypeVar("T")
MOST_FRAMES = 10**6


@router.get("/designs/{design_id}/scene")
def get_pile_scene(request: Request, design_id: str) -> Response:
    """What there is to draw of a design's pile."""
    with database_of(request).reading() as session:
        view = read_models.open_design(session, parse_id(design_id, "design"))
        if view is None:
            raise NotFound(f"There is no design {design_id}.")
        study = session.get_one(StudyRow, view.design.study_id)
    return _scene(pile_scene(study, view.design, view.artifacts, _store(request)))


@router.get("/designs/{design_id}/scene/walls")
def get_pile_walls(request: Request, design_id: str) -> Response:
    """The base on which the pile lies; the cylinder around it is gone when it forms."""
    with database_of(request).reading() as session:
        view = read_models.open_design(session, parse_id(design_id, "design"))
    results = (view.design.results or {}) if view is not None else {}
    if not results.get("rig"):
        raise NotFound(f"There is no base of design {design_id}.")
    return packed(pack_walls(base_plate(results), solid=(0,)))


@router.get("/charges/{charge_id}/scene")
def get_charge_scene(request: Request, charge_id: str) -> Response:
    """What there is to draw of a charge."""
    with database_of(request).reading() as session:
        view = read_charges.open_charge(session, parse_id(charge_id, "charge"))
    if view is None:
        raise NotFound(f"There is no charge {charge_id}.")
    journal = None if view.job is None else _journal(request, view.job.id)
    return _scene(charge_scene(view.charge, view.artifacts, _store(request), journal))


@router.get("/scenes/{scene_id}/frames/{k}")
def get_frame(request: Request, scene_id: str, k: str) -> Response:
    """All grains of a frame, 8 bytes each (service/scene/packing.py)."""
    return packed(pack_frame(_spheres(request, scene_id, k)))


@router.get("/scenes/{scene_id}/frames/{k}/columns/{column}")
def get_column(request: Request, scene_id: str, k: str, column: str) -> Response:
    """One more number of each grain, a byte each."""
    spheres = _spheres(request, scene_id, k)
    values = spheres.speeds if column == "speed" else None
    if column == "arrival" and "Number" in spheres.data and not scene_id.startswith(RUNNING):
        values = _arrivals(spheres, _path(request, scene_id, SPHERE_KINDS))
    if values is None:
        raise NotFound(f"There is no {column[:40]} in this file.")
    return packed(pack_column(values))


@router.get("/scenes/{scene_id}/frames/{k}/grains/{row}")
def get_grain(request: Request, scene_id: str, k: str, row: str) -> Response:
    """One grain, unrounded."""
    spheres = _spheres(request, scene_id, k)
    try:
        return JSONResponse(describe_grain(spheres, _index(row)))
    except IndexError:
        raise NotFound(f"There is no grain {row[:20]} in this frame.") from None


@router.get("/scenes/{scene_id}/frames/{k}/table.csv")
def get_table(request: Request, scene_id: str, k: str) -> Response:
    """All grains of a frame, unrounded."""
    spheres = _spheres(request, scene_id, k)
    name = f"grains-{scene_id}-{int(k)}.csv"
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return StreamingResponse(write_table(spheres), media_type="text/csv; charset=utf-8", headers=headers)


@router.get("/scenes/{walls_id}/walls/{k}")
def get_walls(request: Request, walls_id: str, k: str) -> Response:
    """The triangles of a frame's walls."""
    if walls_id.startswith(RUNNING):
        surface = _read(_running(request, walls_id), k, read_journal_surface)
    else:
        surface = _read(_path(request, walls_id, (WALL_KIND,)), k, read_surface)
    return packed(pack_walls(surface))


def _spheres(request: Request, scene_id: str, k: str) -> Spheres:
    """A frame of a stored file, or of a charge under way."""
    if scene_id.startswith(RUNNING):
        return _read(_running(request, scene_id), k, read_journal_spheres)
    return _read(_path(request, scene_id, SPHERE_KINDS), k, read_spheres)


def _arrivals(spheres: Spheres, path: Path) -> Floats:
    arrivals = read_arrivals(path, RIM_M)[spheres.data["Number"]]
    # What comes later than this frame has not arrived in it.
    return np.where(arrivals <= spheres.time_s, arrivals, np.nan)


def _store(request: Request) -> FileStore:
    settings = request.app.state.settings
    assert isinstance(settings, Settings)
    return artifact_store(settings)


def _path(request: Request, artifact_id: str, kinds: tuple[str, ...]) -> Path:
    """The file of an artifact of these kinds."""
    with database_of(request).reading() as session:
        row = session.get(ArtifactRow, parse_id(artifact_id, "artifact"))
    if row is None or row.kind not in kinds:
        raise NotFound(f"There is no scene {artifact_id}.")
    path = _store(request).local(row.path)
    if not path.is_file():
        raise NotFound(f"The file of artifact {artifact_id} is no longer stored.")
    return path


def _journal(request: Request, job_id: str) -> Path:
    settings = request.app.state.settings
    assert isinstance(settings, Settings)
    return settings.series_folder(job_id) / JOURNAL


def _running(request: Request, scene_id: str) -> Path:
    """The journal of a charge under way, by `running-ID`."""
    with database_of(request).reading() as session:
        view = read_charges.open_charge(session, parse_id(scene_id.removeprefix(RUNNING), "charge"))
    if view is None or view.job is None or not (path := _journal(request, view.job.id)).is_file():
        raise NotFound(f"There are no frames of a charge under way at {scene_id[:40]}.")
    return path


def _index(text: str) -> int:
    """A row or frame number of an address; one that cannot be is beyond every end."""
    return int(text) if text.isascii() and text.isdigit() and len(text) < 10 else MOST_FRAMES**2


def _read(path: Path, k: str, read: Callable[[Path, int], T]) -> T:
    try:
        return read(path, _index(k))
    except IndexError:
        raise NotFound(f"There is no frame {k[:20]}.") from None
    except Unreadable as error:
        raise NotFound(f"There is nothing to draw: {error}.") from None


def packed(content: bytes) -> Response:
    """A page keeps its frames itself: like every answer with data, it stays out of the browser's cache."""
    return Response(content, media_type=MEDIA_TYPE, headers={"Cache-Control": "no-store"})


def _scene(scene: Scene) -> Response:
    content: dict[str, Any] = scene.as_dict()
    return JSONResponse(content, headers={"Cache-Control": "no-store"})

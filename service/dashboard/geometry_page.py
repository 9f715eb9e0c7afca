"""Uploaded meshes as their pages show them: a list, and each in 3D with what its size would be in every unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from fastapi import APIRouter, Request, Response
from fastapi.responses import JSONResponse

from demcore.errors import InputError
from demcore.geometry.mesh_file import UNITS, load_mesh
from service.dashboard.pages import Before, database_of, draw_parts, list_page, parse_id, parts_answer
from service.dashboard.rendering import PageRoute, page
from service.dashboard.scene_manifest import HEIGHT, Scene
from service.dashboard.scene_routes import packed
from service.db.models import GeometryRow
from service.db.read_geometries import list_geometries
from service.errors import NotFound
from service.file_store import geometry_store
from service.scene.packing import pack_frame, pack_walls
from service.scene.sphere_file import Spheres, Surface
from service.settings import Settings

router = APIRouter(include_in_schema=False, route_class=PageRoute)
# What the viewer asks for: its refusals are for a program.
scene_router = APIRouter(include_in_schema=False)

PAGE_SIZE = 50
# A part of a plant is hardly smaller or larger than this; outside, the unit is probably another.
SMALLEST_M, LARGEST_M = 0.01, 100.0
NO_GRAINS = Spheres(0.0, np.empty((0, 3)), np.empty(0), {})


@dataclass(frozen=True)
class Measure:
    """What the mesh measures where its file is in `unit`."""

    unit: str
    size: str
    is_likely: bool


@dataclass(frozen=True)
class GeometryPage:
    """Everything that the templates of a mesh read."""

    row: GeometryRow

    @property
    def sides(self) -> Sequence[float]:
        """Along x, y and z, in the file's own unit."""
        return [float(self.row.extent.get(axis, 0.0)) for axis in "xyz"]

    @property
    def told(self) -> str:
        return " × ".join(f"{side:.4g}" for side in self.sides)

    @property
    def is_watertight(self) -> bool:
        return bool(self.row.extent.get("watertight"))

    @property
    def measures(self) -> Sequence[Measure]:
        found = []
        for unit, metres in UNITS.items():
            sides = [side * metres for side in self.sides]
            text = " × ".join(f"{side:.3g}" for side in sides) + " m"
            found.append(Measure(unit, text, SMALLEST_M <= max(sides) <= LARGEST_M))
        return found


@router.get("/geometries")
def geometries(request: Request, before: Before = None) -> Response:
    """All uploaded meshes, newest first."""
    return list_page("geometries", "Uploaded meshes", "", before, _listed(request, before))


@router.get("/geometries/parts")
def geometries_parts(request: Request, before: Before = None) -> Response:
    """What changes on the list."""
    return parts_answer(0, False, draw_parts(("geometries",), **_listed(request, before)))


@router.get("/geometries/{geometry_id}")
def geometry(request: Request, geometry_id: str) -> Response:
    """One mesh."""
    return page("geometry.html", shown=GeometryPage(_row(request, geometry_id)))


def _listed(request: Request, before: int | None) -> dict[str, Any]:
    with database_of(request).reading() as session:
        rows = list_geometries(session, PAGE_SIZE + 1, before)
    return {
        "meshes": [GeometryPage(row) for row in rows[:PAGE_SIZE]],
        "older": rows[PAGE_SIZE - 1].id if len(rows) > PAGE_SIZE else None,
        "is_first": before is None,
    }


def _row(request: Request, geometry_id: str) -> GeometryRow:
    with database_of(request).reading() as session:
        row = session.get(GeometryRow, parse_id(geometry_id, "geometry"))
    if row is None:
        raise NotFound(f"There is no geometry {geometry_id[:40]}.")
    return row


@scene_router.get("/geometries/{geometry_id}/scene")
def get_mesh_scene(request: Request, geometry_id: str) -> Response:
    """The mesh alone, without grains; its lengths are in the file's own unit."""
    row = _row(request, geometry_id)
    address = f"/geometries/{row.id}/scene"
    frame = {"time_s": 0.0, "grains": 0, "url": f"{address}/grains", "walls": f"{address}/walls"}
    title = f"{row.file_name}, lengths in the file's own unit"
    scene = Scene("ready", title=title, frames=[frame], materials={}, colours=[HEIGHT], is_mesh=True)
    return JSONResponse(scene.as_dict(), headers={"Cache-Control": "no-store"})


@scene_router.get("/geometries/{geometry_id}/scene/grains")
def get_no_grains(request: Request, geometry_id: str) -> Response:
    """The frame that goes with it."""
    _row(request, geometry_id)
    return packed(pack_frame(NO_GRAINS))


@scene_router.get("/geometries/{geometry_id}/scene/walls")
def get_mesh(request: Request, geometry_id: str) -> Response:
    """Its triangles."""
    row = _row(request, geometry_id)
    settings = request.app.state.settings
    assert isinstance(settings, Settings)
    try:
        mesh, _ = load_mesh(geometry_store(settings).local(row.path), "m")
    except InputError as error:
        raise NotFound(f"The file of geometry {row.id} cannot be shown: {error.allowed}.") from None
    surface = Surface(mesh.vertices, np.asarray(mesh.faces, np.int64), np.zeros(len(mesh.faces), np.int64))
    return packed(pack_walls(surface, solid=(0,)))

"""Meshes that stand for parts of a plant."""

from __future__ import annotations

from typing import Annotated, Any, Self

from fastapi import APIRouter, Body, Query
from pydantic import BaseModel, Field

from service.api.dependencies import DatabaseDep, GeometriesDep, IdCursor, Limit, RowId
from service.api.problems import problem_responses
from service.db.models import GeometryRow
from service.db.read_geometries import list_geometries
from service.errors import NotFound
from service.studies.store_geometry import keep_mesh, store_geometry

router = APIRouter(prefix="/v1/geometries", tags=["charges"])

GEOMETRIES_PATH = "/v1/geometries"
FileName = Annotated[str, Query(min_length=1, max_length=100, description="STL, OBJ or PLY by its ending")]


class GeometryAnswer(BaseModel):
    """An uploaded mesh. A charge names it: `{"plant": {"deflector": {"geometry": 1, "units": "mm"}}}`."""

    id: int
    file_name: str
    sha256: str
    size_bytes: int
    triangles: int
    extent: dict[str, Any] = Field(description="size in the file's own unit, and whether it is watertight")

    @classmethod
    def of(cls, row: GeometryRow) -> Self:
        return cls(**{name: getattr(row, name) for name in cls.model_fields})


@router.post("", status_code=201, operation_id="createGeometry", responses=problem_responses(422))
def post_geometry(
    content: Annotated[bytes, Body(media_type="application/octet-stream")],
    file_name: FileName,
    database: DatabaseDep,
    geometries: GeometriesDep,
) -> GeometryAnswer:
    """Upload a mesh, the file's bytes as the body. Its unit is said where it is used."""
    mesh = keep_mesh(geometries, file_name, content)
    with database.writing() as session:
        return GeometryAnswer.of(store_geometry(session, mesh))


class GeometryList(BaseModel):
    """A page of meshes."""

    items: list[GeometryAnswer]
    next_cursor: int | None


@router.get("", operation_id="listGeometries", responses=problem_responses(422))
def get_geometries(database: DatabaseDep, limit: Limit = 50, cursor: IdCursor = None) -> GeometryList:
    """Meshes, newest first."""
    with database.reading() as session:
        rows = list_geometries(session, limit + 1, cursor)
        items = [GeometryAnswer.of(row) for row in rows[:limit]]
    return GeometryList(items=items, next_cursor=items[-1].id if len(rows) > limit else None)


@router.get("/{geometry_id}", operation_id="getGeometry", responses=problem_responses(404, 422))
def get_geometry(geometry_id: RowId, database: DatabaseDep) -> GeometryAnswer:
    """One mesh."""
    with database.reading() as session:
        row = session.get(GeometryRow, geometry_id)
        if row is None:
            raise NotFound(f"There is no geometry {geometry_id}.")
        return GeometryAnswer.of(row)

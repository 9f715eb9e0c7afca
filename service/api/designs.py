"""Designs and their files."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import FileResponse

from service.api.dependencies import ArtifactsDep, DatabaseDep, RowId
from service.api.problems import problem_responses
from service.api.views import ArtifactList, DesignAnswer
from service.db import read_models
from service.db.models import ArtifactRow, DesignRow
from service.errors import NotFound

router = APIRouter(prefix="/v1", tags=["designs"])

# A report is shown in the browser: it may draw itself, and reach nothing.
SEALED = "sandbox; default-src 'none'; img-src data:; style-src 'unsafe-inline'"


@router.get("/designs/{design_id}", operation_id="getDesign", responses=problem_responses(404, 422))
def get_design(design_id: RowId, database: DatabaseDep) -> DesignAnswer:
    """One design, with its results (profile of the pile included) and files."""
    with database.reading() as session:
        view = read_models.open_design(session, design_id)
        if view is None:
            raise NotFound(f"There is no design {design_id}.")
        return DesignAnswer.of(view)


@router.get(
    "/designs/{design_id}/artifacts", operation_id="listArtifacts", responses=problem_responses(404, 422)
)
def list_artifacts(design_id: RowId, database: DatabaseDep) -> ArtifactList:
    """The files of a design."""
    with database.reading() as session:
        if session.get(DesignRow, design_id) is None:
            raise NotFound(f"There is no design {design_id}.")
        return ArtifactList.of(read_models.artifacts_of_design(session, design_id))


@router.get(
    "/artifacts/{artifact_id}",
    operation_id="getArtifact",
    response_class=FileResponse,
    responses={
        200: {
            "description": "The file's bytes, with its own media type",
            "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
        },
        **problem_responses(404, 422),
    },
)
def get_artifact(artifact_id: RowId, database: DatabaseDep, artifacts: ArtifactsDep) -> FileResponse:
    """One file. Its path comes from the database, never from the client; the name is content-addressed."""
    with database.reading() as session:
        row = session.get(ArtifactRow, artifact_id)
    if row is None:
        raise NotFound(f"There is no artifact {artifact_id}.")
    path = artifacts.local(row.path)
    if not path.is_file():
        raise NotFound(f"The file of artifact {artifact_id} is no longer stored.")
    inline = row.media_type.startswith("image/") or row.media_type == "text/html"
    return FileResponse(
        path,
        media_type=row.media_type,
        filename=row.file_name,
        content_disposition_type="inline" if inline else "attachment",
        headers={
            "ETag": f'"{row.sha256}"',
            "X-Content-Type-Options": "nosniff",
            "Content-Security-Policy": SEALED,
        },
    )

"""Studies as files: the whole one as JSON, its designs as tables, and the way back in."""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

from fastapi import APIRouter, Response

from service.api.dependencies import DatabaseDep, RowId
from service.api.problems import problem_responses
from service.api.studies import no_study
from service.api.views import StudyAnswer
from service.db import read_models
from service.db.session import Database
from service.studies.design_table import DesignTable, design_table, to_csv, to_parquet
from service.studies.export_study import export_study
from service.studies.import_study import import_study
from service.studies.read_noise import read_noise
from service.studies.study_file import StudyFile

router = APIRouter(prefix="/v1/studies", tags=["exports"])

TALUS_VERSION = version("talus")
IMPORT_PATH = "/v1/studies/import"
CSV, PARQUET = "text/csv; charset=utf-8", "application/vnd.apache.parquet"


def _file(media_type: str) -> dict[int | str, dict[str, Any]]:
    content = {media_type.partition(";")[0]: {"schema": {"type": "string", "format": "binary"}}}
    return {200: {"description": "The file", "content": content}, **problem_responses(404, 422)}


@router.get(
    "/{study_id}/export",
    operation_id="exportStudy",
    response_class=Response,
    responses={200: {"model": StudyFile, "description": "The study"}, **problem_responses(404, 422)},
)
def get_export(study_id: RowId, database: DatabaseDep) -> Response:
    """The whole study as one JSON, which POST /v1/studies/import of another installation reads."""
    with database.reading() as session:
        file = export_study(session, study_id, TALUS_VERSION)
    if file is None:
        raise no_study(study_id)
    headers = {"Content-Disposition": f'attachment; filename="study-{study_id}.json"'}
    # Written as it is: a pass through the model could turn 1 into 1.0, and the hash is of the text.
    return Response(
        json.dumps(file, indent=1, allow_nan=False), media_type="application/json", headers=headers
    )


@router.get(
    "/{study_id}/designs.csv", operation_id="exportDesignsCsv", response_class=Response, responses=_file(CSV)
)
def get_csv(study_id: RowId, database: DatabaseDep) -> Response:
    """The designs, a line each; texts that a spreadsheet would run as a formula are escaped."""
    return _table(study_id, database, to_csv, CSV, "designs.csv")


@router.get(
    "/{study_id}/designs.parquet",
    operation_id="exportDesignsParquet",
    response_class=Response,
    responses=_file(PARQUET),
)
def get_parquet(study_id: RowId, database: DatabaseDep) -> Response:
    """The same table as Parquet."""
    return _table(study_id, database, to_parquet, PARQUET, "designs.parquet")


@router.post(
    "/import",
    status_code=201,
    operation_id="importStudy",
    responses={
        200: {"model": StudyAnswer, "description": "It was imported before"},
        **problem_responses(422),
    },
)
def post_import(file: StudyFile, response: Response, database: DatabaseDep) -> StudyAnswer:
    """Read in a study that was calculated elsewhere: finished, read-only, good for a warm start.

    The same content again gives the study that is there already.
    """
    with database.writing() as session:
        study, is_new = import_study(session, file)
        answer = StudyAnswer.of(study, read_noise(session, study))
    response.status_code = 201 if is_new else 200
    response.headers["Location"] = f"/v1/studies/{answer.id}"
    return answer


def _table(
    study_id: int, database: Database, encode: Callable[[DesignTable], bytes], media_type: str, name: str
) -> Response:
    with database.reading() as session:
        page = read_models.open_study(session, study_id)
        costs = read_models.costs_of_study(session, study_id)
    if page is None:
        raise no_study(study_id)
    disposition = f'attachment; filename="study-{study_id}-{name}"'
    headers = {"Content-Disposition": disposition, "X-Content-Type-Options": "nosniff"}
    return Response(encode(design_table(page, costs)), media_type=media_type, headers=headers)

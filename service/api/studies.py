"""Studies: ask for a calibration, see how far it is, stop it."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Header, Response

from service.api.dependencies import DatabaseDep, IdCursor, Limit, RowId
from service.api.problems import problem_responses
from service.api.study_body import StudyBody
from service.api.views import DesignAnswer, DesignList, StudyAnswer, StudyList
from service.db import read_models
from service.db.models import StudyRow
from service.errors import FieldError, InvalidRequest, NotFound
from service.studies.create_study import KeyReused, create_study
from service.studies.read_noise import read_noise

router = APIRouter(prefix="/v1/studies", tags=["studies"])

IdempotencyKey = Annotated[
    str | None,
    Header(
        min_length=1,
        max_length=200,
        pattern=r"^[\x21-\x7e]+$",
        description="the same key with the same body gives the same study, however often it is sent",
    ),
]


def no_study(study_id: int) -> NotFound:
    """The refusal of an id that no study has."""
    return NotFound(f"There is no study {study_id}.")


@router.post("", status_code=201, operation_id="createStudy", responses=problem_responses(422))
def post_study(
    body: StudyBody, response: Response, database: DatabaseDep, idempotency_key: IdempotencyKey = None
) -> StudyAnswer:
    """Start a calibration. It is stored when the answer comes, whether or not a worker or the broker runs."""
    spec = body.to_spec()
    with database.writing() as session:
        try:
            study, _ = create_study(session, spec, idempotency_key)
        except KeyReused as error:
            refusal = FieldError("Idempotency-Key", idempotency_key, f"a new key: this one {error}")
            raise InvalidRequest.of(refusal) from error
        answer = StudyAnswer.of(study, read_noise(session, study))
    response.headers["Location"] = f"/v1/studies/{answer.id}"
    return answer


@router.get("", operation_id="listStudies", responses=problem_responses(422))
def list_studies(database: DatabaseDep, limit: Limit = 50, cursor: IdCursor = None) -> StudyList:
    """Studies, newest first."""
    with database.reading() as session:
        rows = read_models.list_studies(session, limit + 1, before=cursor)
        items = [StudyAnswer.of(row) for row in rows[:limit]]
    return StudyList(items=items, next_cursor=items[-1].id if len(rows) > limit else None)


@router.get("/{study_id}", operation_id="getStudy", responses=problem_responses(404, 422))
def get_study(study_id: RowId, database: DatabaseDep) -> StudyAnswer:
    """One study."""
    with database.reading() as session:
        row = session.get(StudyRow, study_id)
        if row is None:
            raise no_study(study_id)
        return StudyAnswer.of(row, read_noise(session, row))


@router.get("/{study_id}/designs", operation_id="listDesigns", responses=problem_responses(404, 422))
def list_designs(
    study_id: RowId, database: DatabaseDep, limit: Limit = 200, cursor: IdCursor = None
) -> DesignList:
    """The designs of a study by number, with what was predicted for each and what came out."""
    with database.reading() as session:
        if session.get(StudyRow, study_id) is None:
            raise no_study(study_id)
        views = read_models.list_designs(session, study_id, limit + 1, after=cursor or 0)
        items = [DesignAnswer.of(view) for view in views[:limit]]
    return DesignList(items=items, next_cursor=items[-1].number if len(views) > limit else None)

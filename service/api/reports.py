"""Reports on a study, and the parameter sets that a charge simulation may take from them."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query
from sqlalchemy.orm import Session

from service.api.dependencies import DatabaseDep, RowId
from service.api.problems import problem_responses
from service.api.studies import no_study
from service.api.views import EnsembleAnswer, JobAnswer, ReportAnswer, as_utc
from service.db import read_models
from service.db.models import ReportRow, StudyRow
from service.errors import Conflict, FieldError, InvalidRequest, NotFound
from service.studies.request_report import request_report

router = APIRouter(prefix="/v1/studies", tags=["reports"])

Members = Annotated[int, Query(ge=1, le=100, description="parameter sets")]


@router.post(
    "/{study_id}/report", status_code=202, operation_id="requestReport", responses=problem_responses(404, 422)
)
def post_report(study_id: RowId, database: DatabaseDep) -> JobAnswer:
    """Ask for a report on what is known now. When a study ends, one is written without being asked for."""
    with database.writing() as session:
        job = request_report(session, study_id)
        if job is None:
            raise no_study(study_id)
        return JobAnswer.of(job)


@router.get("/{study_id}/report", operation_id="getReport", responses=problem_responses(404, 422))
def get_report(study_id: RowId, database: DatabaseDep) -> ReportAnswer:
    """The newest report."""
    with database.reading() as session:
        row = _newest(session, study_id)
        return ReportAnswer(
            study_id=study_id,
            designs=row.designs,
            is_current=not read_models.has_ended_since(session, study_id, row.created_at),
            code_version=row.code_version,
            created_at=as_utc(row.created_at),
            report=row.content,
        )


@router.get("/{study_id}/ensemble", operation_id="getEnsemble", responses=problem_responses(404, 409, 422))
def get_ensemble(study_id: RowId, database: DatabaseDep, n: Members = 5) -> EnsembleAnswer:
    """The optimum and n - 1 alternates of the newest report, each as far from the others as can be."""
    with database.reading() as session:
        content = _newest(session, study_id).content
    found = content.get("ensemble")
    if not isinstance(found, dict):
        raise Conflict(f"Study {study_id} has no ensemble: {content.get('text') or 'its report has none'}")
    members = found["members"]
    if n > len(members):
        raise InvalidRequest.of(FieldError("n", n, f"1 to {len(members)}, which the report has"))
    # Each member's weight is its share among all of them: for fewer it would be another.
    chosen = (
        members if n == len(members) else [{k: v for k, v in m.items() if k != "weight"} for m in members[:n]]
    )
    return EnsembleAnswer(study_id=study_id, level=found.get("level"), text=found.get("text"), members=chosen)


def _newest(session: Session, study_id: int) -> ReportRow:
    row = read_models.newest_report(session, study_id)
    if row is None:
        if session.get(StudyRow, study_id) is None:
            raise no_study(study_id)
        raise NotFound(
            f"No report on study {study_id} is written yet; POST /v1/studies/{study_id}/report asks for one."
        )
    return row

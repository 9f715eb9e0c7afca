"""Jobs: what workers do, and did."""

from __future__ import annotations

import math
from typing import Annotated
from uuid import UUID

from fastapi import APIRouter, Query

from service.api.dependencies import LARGEST_ID, DatabaseDep, Limit
from service.api.problems import problem_responses
from service.api.views import JobAnswer, JobList
from service.db import read_models
from service.db.models import JobRow
from service.domain.states import JobState
from service.errors import Conflict, FieldError, InvalidRequest, NotFound
from service.studies.cancel_job import JobNotCancellable, cancel_job

router = APIRouter(prefix="/v1/jobs", tags=["jobs"])

JobCursor = Annotated[str | None, Query(max_length=80, description="`next_cursor` of the page before")]
StudyFilter = Annotated[int | None, Query(ge=1, le=LARGEST_ID)]


@router.get("", operation_id="listJobs", responses=problem_responses(422))
def list_jobs(
    database: DatabaseDep,
    limit: Limit = 50,
    cursor: JobCursor = None,
    state: JobState | None = None,
    study_id: StudyFilter = None,
) -> JobList:
    """Jobs, newest first."""
    before = None if cursor is None else _parse_cursor(cursor)
    with database.reading() as session:
        rows = read_models.list_jobs(session, limit + 1, before, state, study_id)
        items = [JobAnswer.of(row) for row in rows[:limit]]
    more = len(rows) > limit
    last = rows[limit - 1] if more else None
    return JobList(items=items, next_cursor=None if last is None else f"{last.created_at!r}_{last.id}")


@router.get("/{job_id}", operation_id="getJob", responses=problem_responses(404, 422))
def get_job(job_id: UUID, database: DatabaseDep) -> JobAnswer:
    """One job with all its attempts."""
    with database.reading() as session:
        row = session.get(JobRow, str(job_id))
        if row is None:
            raise NotFound(f"There is no job {job_id}.")
        return JobAnswer.of(row, read_models.runs_of_job(session, row.id))


@router.post(
    "/{job_id}/cancel", status_code=202, operation_id="cancelJob", responses=problem_responses(404, 409, 422)
)
def post_cancel(job_id: UUID, database: DatabaseDep) -> JobAnswer:
    """Cancel one simulation. A queued one ends now, a running one within a second or two."""
    with database.writing() as session:
        try:
            row = cancel_job(session, str(job_id))
        except JobNotCancellable as error:
            raise Conflict(f"Job {job_id} cannot be cancelled: {error}.") from error
        if row is None:
            raise NotFound(f"There is no job {job_id}.")
        return JobAnswer.of(row)


def _parse_cursor(cursor: str) -> tuple[float, str]:
    seconds, _, job_id = cursor.partition("_")
    try:
        created_at, job = float(seconds), str(UUID(job_id))
    except ValueError:
        created_at, job = math.nan, ""
    if not math.isfinite(created_at):
        raise InvalidRequest.of(FieldError("cursor", cursor, "the next_cursor of a page before"))
    return created_at, job

"""Ask a worker for a report on what is known of a study, whatever state it is in."""

from __future__ import annotations

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import JobRow
from service.domain.states import OPEN_JOBS, JobKind
from service.studies.advance_study import add_job


def request_report(session: Session, study_id: int) -> JobRow | None:
    """The report's job; while one is open, that one. None: no such study."""
    study = queries.lock_study(session, study_id)
    if study is None:
        return None
    open_report = select(JobRow).where(
        JobRow.study_id == study_id, JobRow.kind == JobKind.REPORT, JobRow.state.in_(OPEN_JOBS)
    )
    found = session.scalars(open_report).one_or_none()
    if found is not None:
        return found
    job = add_job(session, study_id, JobKind.REPORT)
    session.flush()
    session.refresh(job)
    return job

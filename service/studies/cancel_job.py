"""Cancel one simulation; its study goes on without that design."""

from __future__ import annotations

from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import JobRow
from service.domain.states import JobKind, JobState
from service.studies.advance_study import advance_study
from service.studies.withdraw_jobs import withdraw_job


class JobNotCancellable(ValueError):
    """The job is over, or the study cannot go on without it."""


def cancel_job(session: Session, job_id: str) -> JobRow | None:
    """None: no such job. A queued job ends now, a running one when its worker notices."""
    study_id = queries.study_of_job(session, job_id)
    study = queries.lock_study(session, study_id) if study_id is not None else None
    job = session.get(JobRow, job_id, populate_existing=True) if study is not None else None
    if study is None or job is None:
        return None
    if job.state is JobState.CANCELLED:
        return job
    if job.kind is not JobKind.SIMULATE:
        raise JobNotCancellable(f"a {job.kind.value} job carries its study: cancel study {study.id} instead")
    if not withdraw_job(session, job):
        raise JobNotCancellable(f"the job is {job.state.value} already")
    advance_study(session, study)
    session.refresh(job)
    return job

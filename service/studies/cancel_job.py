"""Cancel one piece of work: a charge, a diagnosis, or a design, without which its study goes on."""

from __future__ import annotations

from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import JobRow, StudyRow
from service.domain.states import JobKind, JobState
from service.studies.advance_study import advance_study
from service.studies.withdraw_jobs import withdraw_job


class JobNotCancellable(ValueError):
    """The job is over, or the study cannot go on without it."""


def cancel_job(session: Session, job_id: str) -> JobRow | None:
    """None: no such job. A queued job ends now, a running one when its worker notices."""
    owner = queries.lock_owner(session, job_id)
    job = session.get(JobRow, job_id, populate_existing=True) if owner is not None else None
    if owner is None or job is None:
        return None
    if job.state is JobState.CANCELLED:
        return job
    if job.kind not in (JobKind.SIMULATE, JobKind.CHARGE, JobKind.DIAGNOSE):
        raise JobNotCancellable(f"a {job.kind.value} job carries its study: cancel study {owner.id} instead")
    if not withdraw_job(session, job):
        raise JobNotCancellable(f"the job is {job.state.value} already")
    if isinstance(owner, StudyRow):
        advance_study(session, owner)
    session.refresh(job)
    return job

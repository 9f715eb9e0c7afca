"""Close a job's fence for good, under its study's lock: the first step of recording any result."""

from __future__ import annotations

from dataclasses import dataclass

from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import DesignRow, JobRow, StudyRow
from service.db.queries import Lease
from service.domain.states import JobState


@dataclass(frozen=True)
class FinishedJob:
    """The rows that belong to a job which this transaction has just ended."""

    study: StudyRow
    job: JobRow
    design: DesignRow | None


def finish_job(
    session: Session, lease: Lease, state: JobState, failure_text: str | None = None
) -> FinishedJob | None:
    """None: the fence is closed, the caller discards what it has."""
    study_id = queries.study_of_job(session, lease.job_id)
    study = queries.lock_study(session, study_id) if study_id is not None else None
    if study is None or not queries.finish(session, lease, state, failure_text):
        return None
    return rows_of(session, study, session.get_one(JobRow, lease.job_id))


def rows_of(session: Session, study: StudyRow, job: JobRow) -> FinishedJob:
    """The job's rows as the database has them now."""
    design = session.get_one(DesignRow, job.design_id, populate_existing=True) if job.design_id else None
    return FinishedJob(study, job, design)

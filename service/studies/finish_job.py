"""Close a job's fence for good, under its owner's lock: the first step of recording any result."""

from __future__ import annotations

from dataclasses import dataclass

from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import DesignRow, JobRow, StudyRow, TaskRow
from service.db.queries import Lease
from service.domain.states import JobState


@dataclass(frozen=True)
class FinishedJob:
    """The rows that belong to a job which this transaction has just ended: its study, with a design or without,
    or its charge or diagnosis."""

    owner: StudyRow | TaskRow
    job: JobRow
    design: DesignRow | None

    @property
    def study(self) -> StudyRow:
        """The owner, where the job is a study's."""
        assert isinstance(self.owner, StudyRow)
        return self.owner


def finish_job(
    session: Session, lease: Lease, state: JobState, failure_text: str | None = None
) -> FinishedJob | None:
    """None: the fence is closed, the caller discards what it has."""
    owner = queries.lock_owner(session, lease.job_id)
    if owner is None or not queries.finish(session, lease, state, failure_text):
        return None
    return rows_of(session, owner, session.get_one(JobRow, lease.job_id))


def rows_of(session: Session, owner: StudyRow | TaskRow, job: JobRow) -> FinishedJob:
    """The job's rows as the database has them now."""
    design = session.get_one(DesignRow, job.design_id, populate_existing=True) if job.design_id else None
    return FinishedJob(owner, job, design)

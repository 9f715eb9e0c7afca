"""Counts for the metrics."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from service.db.clock import database_now
from service.db.models import ArtifactRow, JobRow, RunRow, StudyRow
from service.domain.states import JobKind, JobState, StudyState


def jobs_by_kind_and_state(session: Session) -> Sequence[tuple[JobKind, JobState, int]]:
    """How many jobs of each kind are in each state."""
    statement = select(JobRow.kind, JobRow.state, func.count()).group_by(JobRow.kind, JobRow.state)
    return [(row[0], row[1], row[2]) for row in session.execute(statement)]


def studies_by_state(session: Session) -> Sequence[tuple[StudyState, int]]:
    """How many studies are in each state."""
    statement = select(StudyRow.state, func.count()).group_by(StudyRow.state)
    return [(row[0], row[1]) for row in session.execute(statement)]


def attempts_by_end(session: Session) -> Sequence[tuple[str, int]]:
    """How many attempts ended in each way: done, lost, cancelled, released, or a failure's class."""
    statement = (
        select(RunRow.exit_class, func.count())
        .where(RunRow.exit_class.is_not(None))
        .group_by(RunRow.exit_class)
    )
    return [(row[0] or "", row[1]) for row in session.execute(statement)]


def longest_wait_s(session: Session) -> float:
    """Seconds since the oldest queued job was made; 0 without any."""
    oldest = select(database_now() - func.min(JobRow.created_at)).where(JobRow.state == JobState.QUEUED)
    return max(0.0, session.scalar(oldest) or 0.0)


def paused_jobs(session: Session) -> int:
    """Queued jobs with a reason to wait."""
    statement = select(func.count(JobRow.id)).where(
        JobRow.state == JobState.QUEUED, JobRow.pause_reason.is_not(None)
    )
    return session.scalar(statement) or 0


def artifact_bytes(session: Session) -> int:
    """The sum of all files that were stored, one that is shared counted each time."""
    return int(session.scalar(select(func.sum(ArtifactRow.size_bytes))) or 0)

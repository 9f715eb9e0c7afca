"""Record that a worker stopped because it was asked to."""

from __future__ import annotations

from sqlalchemy.orm import Session

from service.db.models import TaskRow
from service.db.queries import Lease
from service.domain.outcome import RunCost
from service.domain.states import DesignState, JobState
from service.studies.advance_study import advance_study
from service.studies.close_run import close_run
from service.studies.finish_job import FinishedJob, finish_job
from service.studies.move_task import move_task
from service.studies.withdraw_jobs import cancel_design


def record_cancellation(session: Session, lease: Lease, cost: RunCost | None = None) -> bool:
    """False: the lease was lost, nothing is written."""
    ended = finish_job(session, lease, JobState.CANCELLED)
    if ended is None:
        return False
    settle_cancellation(session, ended, lease, cost)
    return True


def settle_cancellation(
    session: Session, ended: FinishedJob, lease: Lease, cost: RunCost | None = None
) -> None:
    """What follows from a job that is cancelled already."""
    close_run(session, lease, "cancelled", cost=cost)
    if isinstance(ended.owner, TaskRow):
        move_task(session, ended.owner, DesignState.CANCELLED)
        return
    if ended.design is not None:
        cancel_design(session, ended.design)
    advance_study(session, ended.study)

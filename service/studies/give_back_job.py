"""Give a job back to the queue: the worker stops in order, or a retry rule wants another attempt."""

from __future__ import annotations

from dataclasses import dataclass

from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import TaskRow
from service.db.queries import Lease
from service.domain.outcome import RunCost
from service.domain.states import DesignState, JobState, require_change
from service.studies.close_run import close_run
from service.studies.finish_job import FinishedJob, rows_of
from service.studies.move_task import move_task
from service.studies.record_cancellation import settle_cancellation
from service.studies.record_event import record_design_event


@dataclass(frozen=True)
class Return:
    """Why a job goes back: `counts` uses up an attempt, `time_step_factor` is for the next ones, `pause_s` is how
    long nobody shall be told of it."""

    exit_class: str
    text: str
    counts: bool = False
    time_step_factor: float | None = None
    pause_s: float | None = None


def give_back_job(session: Session, lease: Lease, why: Return, cost: RunCost | None = None) -> bool:
    """False: the lease was lost, nothing is written."""
    owner = queries.lock_owner(session, lease.job_id)
    if owner is None:
        return False
    pause = None if why.pause_s is None else queries.Pause(why.pause_s, why.text)
    job = queries.give_back(session, lease, why.counts, why.time_step_factor, pause)
    if job is None:
        return False
    ended = rows_of(session, owner, job)
    if job.state is JobState.CANCELLED:
        settle_cancellation(session, ended, lease, cost)
    else:
        settle_return(session, ended, lease, why, cost)
    return True


def settle_return(
    session: Session, ended: FinishedJob, lease: Lease, why: Return, cost: RunCost | None = None
) -> None:
    """What follows from a job that is queued again already."""
    close_run(session, lease, why.exit_class, why.text, cost)
    if isinstance(ended.owner, TaskRow):
        move_task(session, ended.owner, DesignState.WAITING)
    design = ended.design
    if design is not None:
        require_change(design.state, DesignState.WAITING)
        design.state = DesignState.WAITING
        record_design_event(session, design, "design_returned", exit_class=why.exit_class, text=why.text)

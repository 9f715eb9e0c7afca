"""Take a job from a worker that vanished: its lease ran out."""

from __future__ import annotations

from sqlalchemy.orm import Session

from service.db import queries
from service.db.queries import Lease
from service.domain.outcome import Failure, FailureClass
from service.domain.states import JobState
from service.studies.finish_job import rows_of
from service.studies.give_back_job import Return, settle_return
from service.studies.record_cancellation import settle_cancellation
from service.studies.record_failure import settle_failure


def reap_job(session: Session, lease: Lease) -> JobState | None:
    """Queued again, failed at its last attempt, or cancelled. None: somebody else was faster.

    One transaction a job, its owner's lock first: reaping many never blocks, or deadlocks with, a finishing
    worker.
    """
    owner = queries.lock_owner(session, lease.job_id)
    job = queries.reap(session, lease) if owner is not None else None
    if owner is None or job is None:
        return None
    ended = rows_of(session, owner, job)
    text = f"the worker was not heard of for its whole lease (attempt {lease.attempt})"
    if job.state is JobState.CANCELLED:
        settle_cancellation(session, ended, lease)
    elif job.state is JobState.FAILED:
        failure = Failure(FailureClass.LOST, f"{text}; no attempt is left after {job.attempt}")
        settle_failure(session, ended, lease, failure)
    else:
        settle_return(session, ended, lease, Return(FailureClass.LOST.value, text))
    return job.state

"""A worker that was late for its lease comes back: the job did not kill it, so the attempt must not count."""

from __future__ import annotations

from sqlalchemy import func, select, update
from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import RunRow
from service.db.queries import Lease
from service.domain.outcome import FailureClass
from service.studies.give_back_job import Return, give_back_job

LATE = "late"
# A job whose own work keeps its worker from beating would otherwise go on for ever.
MOST_FORGIVEN = 10


def forgive_attempt(session: Session, lease: Lease) -> bool:
    """Called by a worker that lives, has stopped working at this attempt and wrote nothing.

    Attempts are bounded because a job may kill whoever takes it. One that was lost to a machine that stalled
    is no sign of that: it is called late instead of lost, and does not count. A job that nobody took from the
    worker yet goes back at once. False: nothing to forgive (any more), or too much.
    """
    text = f"the worker came back after its lease (attempt {lease.attempt}): it was late, not dead"
    if give_back_job(session, lease, Return(LATE, text)):
        return True
    if queries.lock_owner(session, lease.job_id) is None:
        return False
    late = (
        select(func.count())
        .select_from(RunRow)
        .where(RunRow.job_id == lease.job_id, RunRow.exit_class == LATE)
    )
    if session.scalars(late).one() >= MOST_FORGIVEN:
        return False
    was_lost = (
        update(RunRow)
        .where(
            RunRow.job_id == lease.job_id,
            RunRow.attempt == lease.attempt,
            RunRow.exit_class == FailureClass.LOST.value,
        )
        .values(exit_class=LATE, exit_text=text)
        .returning(RunRow.id)
    )
    if session.execute(was_lost).scalar_one_or_none() is None:
        return False
    return queries.allow_another_attempt(session, lease.job_id)

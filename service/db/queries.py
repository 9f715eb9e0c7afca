"""The job store's statements: claim, beat, finish, give back and reap, each one fenced statement.

A statement that answers None (or False) found the fence closed: another attempt, or nobody, owns the job now.
The caller then writes nothing more. Nothing here commits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from sqlalchemy import and_, case, func, not_, or_, select, update
from sqlalchemy.orm import Session

from service.db.clock import database_now, lease_now
from service.db.models import ChargeRow, DiagnosisRow, JobRow, StudyRow, TaskRow
from service.domain.states import JobKind, JobState, StudyState, is_over, sources

# A published job that nobody claimed is published again after this long times the square of its publications:
# a lost message is soon replaced, and a long backlog is not buried under copies of itself (9 an hour).
REPUBLISH_AFTER_S = 15.0

# As long as settings allow a lease to be.
LONGEST_LEASE_S = 600.0
LONGEST_PAUSE_S = 3600.0

# A paused study starts no simulation and proposes nothing; a report on it may be written.
CLAIMED_WHILE_PAUSED = (JobKind.REPORT,)

_Task = TypeVar("_Task", ChargeRow, DiagnosisRow)
_UNPUBLISHED = {"lease_until": None, "published_at": None, "publications": 0}
_NOT_PAUSED = {"paused_until": None, "pause_reason": None}


@dataclass(frozen=True)
class Lease:
    """The right to write for a job: its id and the attempt that owns it."""

    job_id: str
    attempt: int


def now(session: Session) -> float:
    """The database's clock: seconds since 1970."""
    return float(session.scalars(select(database_now())).one())


def lock_study(session: Session, study_id: int) -> StudyRow | None:
    """The study's row, locked until the commit (SQLite: the whole database is, by BEGIN IMMEDIATE).

    Every transaction that changes a study's designs, jobs or events takes this lock first. So events of one
    study become visible in the order of their ids, nothing that is due is overlooked, and nothing deadlocks.
    """
    statement = select(StudyRow).where(StudyRow.id == study_id).with_for_update()
    return session.scalars(statement.execution_options(populate_existing=True)).one_or_none()


def lock_task(session: Session, task: type[_Task], task_id: int) -> _Task | None:
    """The row of a charge or a diagnosis, locked until the commit, as a study's is."""
    statement = select(task).where(task.id == task_id).with_for_update()
    return session.scalars(statement.execution_options(populate_existing=True)).one_or_none()


def lock_owner(session: Session, job_id: str) -> StudyRow | TaskRow | None:
    """What a job belongs to, which never changes, locked. None: no such job."""
    statement = select(JobRow.study_id, JobRow.charge_id, JobRow.diagnosis_id).where(JobRow.id == job_id)
    found = session.execute(statement).one_or_none()
    if found is None:
        return None
    if found.charge_id is not None:
        return lock_task(session, ChargeRow, found.charge_id)
    if found.diagnosis_id is not None:
        return lock_task(session, DiagnosisRow, found.diagnosis_id)
    return lock_study(session, found.study_id)


def is_job_over(session: Session, job_id: str) -> bool:
    """True where the job is done, failed or cancelled, or there is none."""
    state = session.scalars(select(JobRow.state).where(JobRow.id == job_id)).one_or_none()
    return state is None or is_over(state)


def claim(session: Session, job_id: str, worker_id: str, lease_s: float) -> JobRow | None:
    """queued -> running for `worker_id`; None when the message was a duplicate, or the job is over."""
    statement = (
        update(JobRow)
        .where(
            JobRow.id == job_id,
            JobRow.state.in_(sources(JobState.RUNNING)),
            JobRow.cancel_requested.is_(False),
            not_(_is_paused()),
        )
        .values(
            **_NOT_PAUSED,
            state=JobState.RUNNING,
            attempt=JobRow.attempt + 1,
            worker_id=worker_id,
            lease_until=lease_now() + lease_s,
            progress=None,
        )
        .returning(JobRow)
        .execution_options(populate_existing=True)
    )
    return session.scalars(statement).one_or_none()


def beat(session: Session, lease: Lease, lease_s: float, progress: dict[str, Any] | None) -> bool | None:
    """Extend the lease, store the progress; the cancel flag comes back. None: fenced, stop, write nothing.

    A lease that ran out but was not reaped yet may be extended: nobody else owns the job.
    """
    values: dict[str, Any] = {"lease_until": lease_now() + lease_s}
    if progress is not None:
        values["progress"] = progress
    statement = update(JobRow).where(_owned(lease)).values(values).returning(JobRow.cancel_requested)
    return session.execute(statement).scalar_one_or_none()


def holds(session: Session, lease: Lease) -> bool:
    """Whether the attempt still owns its job. Under the owner's lock it stays so until the commit."""
    return session.scalar(select(JobRow.id).where(_owned(lease))) is not None


def finish(session: Session, lease: Lease, state: JobState, failure_text: str | None = None) -> bool:
    """running -> done, failed or cancelled, where the attempt is still this one."""
    statement = (
        update(JobRow)
        .where(_owned(lease), JobRow.state.in_(sources(state)))
        .values(state=state, ended_at=database_now(), lease_until=None, failure_text=failure_text)
        .returning(JobRow.id)
    )
    return session.execute(statement).scalar_one_or_none() is not None


@dataclass(frozen=True)
class Pause:
    """A queued job that nobody shall be told of for so many seconds, and why."""

    seconds: float
    reason: str


def give_back(
    session: Session,
    lease: Lease,
    counts: bool,
    time_step_factor: float | None = None,
    pause: Pause | None = None,
) -> JobRow | None:
    """running -> queued where the attempt is still this one; cancelled where that was asked meanwhile.

    `counts`: the attempt uses up one of the job's attempts (it failed for want of memory, say); an orderly
    stop and a repetition by rule do not. `time_step_factor` is for the next attempts.
    """
    values: dict[str, Any] = {
        "state": case((JobRow.cancel_requested, JobState.CANCELLED.value), else_=JobState.QUEUED.value),
        "ended_at": case((JobRow.cancel_requested, database_now()), else_=None),
        "max_attempts": JobRow.max_attempts + (0 if counts else 1),
        **_UNPUBLISHED,
    }
    if time_step_factor is not None:
        values["time_step_factor"] = time_step_factor
    if pause is not None:
        values |= {"paused_until": lease_now() + pause.seconds, "pause_reason": pause.reason}
    statement = update(JobRow).where(_owned(lease)).values(values).returning(JobRow)
    return session.scalars(statement.execution_options(populate_existing=True)).one_or_none()


def allow_another_attempt(session: Session, job_id: str) -> bool:
    """One attempt of the job does not count. False: the job is over."""
    statement = (
        update(JobRow)
        .where(JobRow.id == job_id, JobRow.state.in_((JobState.QUEUED, JobState.RUNNING)))
        .values(max_attempts=JobRow.max_attempts + 1)
        .returning(JobRow.id)
    )
    return session.execute(statement).scalar_one_or_none() is not None


def reap(session: Session, lease: Lease) -> JobRow | None:
    """An attempt whose lease ran out: queued again, failed if it was the last, cancelled if that was asked.

    None: the worker came back, or another reaper was faster.
    """
    exhausted = JobRow.attempt >= JobRow.max_attempts
    over = or_(JobRow.cancel_requested, exhausted)
    statement = (
        update(JobRow)
        .where(_owned(lease), _ran_out())
        .values(
            state=case(
                (JobRow.cancel_requested, JobState.CANCELLED.value),
                (exhausted, JobState.FAILED.value),
                else_=JobState.QUEUED.value,
            ),
            ended_at=case((over, database_now()), else_=None),
            failure_text=case(
                (
                    and_(exhausted, JobRow.cancel_requested.is_(False)),
                    "lost: the worker vanished at every attempt",
                ),
                else_=None,
            ),
            **_UNPUBLISHED,
        )
        .returning(JobRow)
        .execution_options(populate_existing=True)
    )
    return session.scalars(statement).one_or_none()


def cancel_queued(session: Session, job_id: str) -> bool:
    """queued -> cancelled; False when it is not queued (any more)."""
    statement = (
        update(JobRow)
        .where(JobRow.id == job_id, JobRow.state == JobState.QUEUED)
        .values(state=JobState.CANCELLED, cancel_requested=True, ended_at=database_now())
        .returning(JobRow.id)
    )
    return session.execute(statement).scalar_one_or_none() is not None


def withdraw(session: Session, job_id: str) -> bool:
    """queued or running -> cancelled at once: whoever does it finds its fence closed. False: it is over."""
    statement = (
        update(JobRow)
        .where(JobRow.id == job_id, JobRow.state.in_(sources(JobState.CANCELLED)))
        .values(state=JobState.CANCELLED, cancel_requested=True, ended_at=database_now(), lease_until=None)
        .returning(JobRow.id)
    )
    return session.execute(statement).scalar_one_or_none() is not None


def publish_again(session: Session, study_id: int) -> None:
    """The study's queued jobs have no message any more: it was dropped while the study was paused."""
    session.execute(
        update(JobRow)
        .where(JobRow.study_id == study_id, JobRow.state == JobState.QUEUED)
        .values(published_at=None, publications=0)
    )


def ask_to_cancel(session: Session, job_id: str) -> bool:
    """Raise the flag of a running job; its worker sees it at the next beat. False: it is not running."""
    statement = (
        update(JobRow)
        .where(JobRow.id == job_id, JobRow.state == JobState.RUNNING)
        .values(cancel_requested=True)
        .returning(JobRow.id)
    )
    return session.execute(statement).scalar_one_or_none() is not None


def expired(session: Session, limit: int = 100) -> Sequence[Lease]:
    """Running jobs whose lease ran out; `reap` decides about each."""
    statement = (
        select(JobRow.id, JobRow.attempt)
        .where(JobRow.state == JobState.RUNNING, _ran_out())
        .order_by(JobRow.lease_until)
        .limit(limit)
    )
    return [Lease(row.id, row.attempt) for row in session.execute(statement)]


def to_publish(session: Session, limit: int = 500) -> Sequence[tuple[str, JobKind]]:
    """Queued jobs that no message tells of, or whose message has been out for too long; oldest first.

    Those of a paused study are held back.
    """
    waited = database_now() - JobRow.published_at
    patience = REPUBLISH_AFTER_S * JobRow.publications * JobRow.publications
    statement = (
        select(JobRow.id, JobRow.kind)
        .outerjoin(StudyRow, StudyRow.id == JobRow.study_id)
        .where(
            JobRow.state == JobState.QUEUED,
            or_(
                StudyRow.id.is_(None),
                StudyRow.state != StudyState.PAUSED,
                JobRow.kind.in_(CLAIMED_WHILE_PAUSED),
            ),
            or_(JobRow.published_at.is_(None), waited > patience, waited < 0.0),
            not_(_is_paused()),
        )
        .order_by(JobRow.created_at, JobRow.id)
        .limit(limit)
    )
    return [(row.id, JobKind(row.kind)) for row in session.execute(statement)]


def forget_publications(session: Session) -> int:
    """The broker lost its messages: every queued job wants a new one. The number of jobs."""
    statement = (
        update(JobRow)
        .where(JobRow.state == JobState.QUEUED, JobRow.published_at.is_not(None))
        .values(published_at=None, publications=0)
        .returning(JobRow.id)
    )
    found = session.execute(statement, execution_options={"synchronize_session": False})
    return len(found.all())


def mark_published(session: Session, job_ids: Sequence[str]) -> None:
    """These have a message in the broker now. One that was claimed meanwhile keeps what it has."""
    session.execute(
        update(JobRow)
        .where(JobRow.id.in_(job_ids), JobRow.state == JobState.QUEUED)
        .values(published_at=database_now(), publications=JobRow.publications + 1),
        execution_options={"synchronize_session": False},
    )


def _is_paused() -> Any:
    """A pause that ends later than any can was set before the machine started anew, and is over."""
    until = func.coalesce(JobRow.paused_until, 0.0)
    return and_(until > lease_now(), until < lease_now() + 2.0 * LONGEST_PAUSE_S)


def _ran_out() -> Any:
    """The lease is over, or ends later than any can: the machine has started anew since, and its clock with it."""
    return or_(JobRow.lease_until < lease_now(), JobRow.lease_until > lease_now() + 2.0 * LONGEST_LEASE_S)


def _owned(lease: Lease) -> Any:
    return and_(JobRow.id == lease.job_id, JobRow.attempt == lease.attempt, JobRow.state == JobState.RUNNING)

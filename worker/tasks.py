"""The tasks: claim the row, do the work, record what came out.

A message is only a hint. Where the row says that there is nothing to do the task returns, and the row's kind,
not the message's name, says what is done.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import structlog
from sqlalchemy.exc import InterfaceError, OperationalError, StatementError
from sqlalchemy.orm import Session

from demcore.errors import Cancelled
from service.db import queries
from service.domain.outcome import FailureClass
from service.domain.states import JobKind
from service.queue import TASK_NAMES
from service.studies.claim_job import AnyClaim, ChargeClaim, Claim, DiagnosisClaim, claim_job
from service.studies.forgive_attempt import forgive_attempt
from service.studies.give_back_job import Return, give_back_job
from service.studies.record_cancellation import record_cancellation
from service.studies.record_charge import record_charge
from service.studies.record_diagnosis import record_diagnosis
from service.studies.record_failure import record_failure
from service.studies.record_measurement import record_measurement
from service.studies.record_proposal import record_proposal
from service.studies.record_recommendation import record_recommendation
from service.studies.record_report import record_report
from worker import charge, diagnose, evaluate, installation, optimize, plan_tests, process
from worker.app import app
from worker.process import Attempt, StopReason
from worker.recovery import classify, persist, retry_of
from worker.stopwatch import Stopwatch
from worker.study_report import report_of

log = structlog.get_logger(__name__)

# Writes a result in a transaction; False when the fence is closed.
Write = Callable[[Session], bool]


def perform(job_id: str) -> None:
    """Claim, work, record; where the lease was lost, only say so."""
    database, lease_s = installation.database(), installation.settings().lease_seconds
    with database.writing() as session:
        claim = claim_job(session, job_id, process.worker_id, lease_s)
    if claim is None:
        return
    with (
        Attempt(database, claim.lease, lease_s) as attempt,
        structlog.contextvars.bound_contextvars(job=job_id, attempt=claim.lease.attempt),
    ):
        watch = Stopwatch()
        try:
            write: Write | None = work(claim, attempt, watch)
        except Exception as error:  # noqa: BLE001 (the one place: whatever failed is recorded)
            write = after_failure(error, claim, attempt, watch)
        if write is None or not record(claim, write):
            # This worker lives: whoever took the job from it did not know.
            persist(database, partial(forgive_attempt, lease=claim.lease))
    with database.reading() as session:
        is_done_with = queries.is_job_over(session, job_id)
    if is_done_with:
        evaluate.forget_checkpoint(job_id, installation.settings())


def record(claim: AnyClaim, write: Write) -> bool:
    """Write the result; False: the lease was lost, nothing is written.

    A result that the database refuses (not: cannot take now) fails the job. psycopg raises ValueError and
    TypeError itself for what is no JSON, the other driver through SQLAlchemy.
    """
    database = installation.database()
    try:
        recorded = persist(database, write)
    except (StatementError, ValueError, TypeError) as error:
        if isinstance(error, OperationalError | InterfaceError):
            raise
        log.exception("result refused")
        recorded = persist(database, partial(record_failure, lease=claim.lease, failure=classify(error)))
    log.info("recorded" if recorded else "discarded: the lease was lost", kind=claim.kind.value)
    return recorded


def work(claim: AnyClaim, attempt: Attempt, watch: Stopwatch) -> Write:
    """Do what the job's row says."""
    if isinstance(claim, ChargeClaim):
        return simulate_charge(claim, attempt, watch)
    if isinstance(claim, DiagnosisClaim):
        return diagnose_data(claim, attempt, watch)
    return WORK[claim.kind](claim, attempt, watch)


def simulate_charge(claim: ChargeClaim, attempt: Attempt, watch: Stopwatch) -> Write:
    """One charge of the hopper."""
    measurement = charge.evaluate_charge(claim, attempt.report, installation.settings())
    cost = watch.cost(measurement.results)
    return partial(record_charge, lease=claim.lease, measurement=measurement, cost=cost)


def diagnose_data(claim: DiagnosisClaim, attempt: Attempt, watch: Stopwatch) -> Write:
    """One diagnosis of a data set, or what its tests could show."""
    database = installation.database()
    if claim.spec.plan is not None:
        outcome = plan_tests.evaluate_plan(claim, attempt.report, database)
    else:
        outcome = diagnose.evaluate_diagnosis(claim, attempt.report, database, installation.settings())
    return partial(record_diagnosis, lease=claim.lease, outcome=outcome, cost=watch.cost())


def simulate(claim: Claim, attempt: Attempt, watch: Stopwatch) -> Write:
    """One design's pile test."""
    measurement = evaluate.evaluate(claim, attempt.report, installation.settings())
    cost = watch.cost(measurement.results)
    return partial(record_measurement, lease=claim.lease, measurement=measurement, cost=cost)


def propose(claim: Claim, _attempt: Attempt, watch: Stopwatch) -> Write:
    """The next design of a study, or its stop."""
    assert claim.history is not None
    answer = optimize.next_design(claim.history)
    return partial(record_proposal, lease=claim.lease, answer=answer, cost=watch.cost())


def recommend(claim: Claim, _attempt: Attempt, watch: Stopwatch) -> Write:
    """What a study that stopped has found, and whether it would still stop."""
    assert claim.history is not None
    found, answer = optimize.recommendation(claim.history), optimize.next_design(claim.history)
    return partial(
        record_recommendation, lease=claim.lease, recommendation=found, answer=answer, cost=watch.cost()
    )


def report(claim: Claim, _attempt: Attempt, watch: Stopwatch) -> Write:
    """What a study says by now."""
    assert claim.history is not None
    content = report_of(claim.history)
    finished = len(claim.history.finished)
    return partial(record_report, lease=claim.lease, designs=finished, content=content, cost=watch.cost())


WORK: dict[JobKind, Callable[[Claim, Attempt, Stopwatch], Write]] = {
    JobKind.SIMULATE: simulate,
    JobKind.PROPOSE: propose,
    JobKind.RECOMMEND: recommend,
    JobKind.REPORT: report,
}


def after_failure(error: Exception, claim: AnyClaim, attempt: Attempt, watch: Stopwatch) -> Write | None:
    """What to write when the work raised; None: nothing, the job is somebody else's."""
    reason, lease, cost = attempt.stop, claim.lease, watch.cost()
    if reason is StopReason.FENCED:
        return None
    if isinstance(error, Cancelled) and reason is StopReason.CANCELLED:
        return partial(record_cancellation, lease=lease, cost=cost)
    if isinstance(error, Cancelled) and reason is StopReason.SHUTDOWN:
        why = Return("released", "the worker was stopped in order")
        return partial(give_back_job, lease=lease, why=why, cost=cost)
    failure = classify(error)
    unexpected = failure.failure_class is FailureClass.ERROR
    log.warning(
        "attempt failed",
        failure=failure.failure_class.value,
        text=failure.text,
        exc_info=error if unexpected else None,
    )
    pause_s = installation.settings().disk_pause_seconds
    why_again = retry_of(failure, claim.time_step_factor, claim.attempts_left, pause_s)
    if why_again is not None:
        return partial(give_back_job, lease=lease, why=why_again, cost=cost)
    return partial(record_failure, lease=lease, failure=failure, cost=cost)


for name in TASK_NAMES.values():
    app.task(name=name)(perform)

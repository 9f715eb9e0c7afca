"""The job store under any order of events (hypothesis), and under all orders of two workers on one job."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    Bundle,
    RuleBasedStateMachine,
    invariant,
    multiple,
    rule,
    run_state_machine_as_test,
)
from sqlalchemy import select, text, update

from service.db import queries
from service.db.clock import lease_now
from service.db.models import Base, DesignRow, EventRow, JobRow, RunRow, StudyRow
from service.db.queries import Lease
from service.db.session import Database
from service.domain.outcome import Failure, FailureClass
from service.domain.states import DesignState, JobState, Verdict, is_over
from service.studies.advance_study import ATTEMPTS
from service.studies.cancel_job import JobNotCancellable, cancel_job
from service.studies.claim_job import claim_job
from service.studies.forgive_attempt import forgive_attempt
from service.studies.give_back_job import Return, give_back_job
from service.studies.reap_job import reap_job
from service.studies.record_cancellation import record_cancellation
from service.studies.record_failure import record_failure
from service.studies.record_measurement import record_measurement
from tests.builders.studies import a_measurement, a_simulate_job, let_lease_expire

LEASE_S = 60.0


def reap_all(database: Database) -> None:
    with database.reading() as session:
        expired = queries.expired(session)
    for lease in expired:
        with database.writing() as session:
            reap_job(session, lease)


def check_invariants(database: Database) -> None:
    """One owner, one end, and everything that is told agrees with everything that is counted."""
    with database.reading() as session:
        jobs = session.scalars(select(JobRow).where(JobRow.design_id.is_not(None))).all()
        for job in jobs:
            runs = session.scalars(
                select(RunRow).where(RunRow.job_id == job.id).order_by(RunRow.attempt)
            ).all()
            design = session.get_one(DesignRow, job.design_id)
            study = session.get_one(StudyRow, job.study_id)
            kinds = session.execute(
                select(EventRow.kind, EventRow.data).where(EventRow.study_id == study.id)
            ).all()
            ends = [
                data for kind, data in kinds if kind == "design_finished" and data["number"] == design.number
            ]
            open_runs = [run for run in runs if run.ended_at is None]
            assert [run.attempt for run in runs] == list(range(1, job.attempt + 1)), (
                "every attempt has its row"
            )
            assert len(open_runs) == (job.state is JobState.RUNNING), "an attempt is open while its job runs"
            assert not open_runs or open_runs[0].attempt == job.attempt
            assert sum(run.exit_class == "done" for run in runs) == (job.state is JobState.DONE)
            assert len(ends) == is_over(job.state), "the end is told once"
            assert job.attempt <= job.max_attempts
            assert sum(run.exit_class == "lost" for run in runs) <= ATTEMPTS, "lost attempts are bounded"
            assert (job.lease_until is not None) == (job.state is JobState.RUNNING)
            assert DESIGN_OF[job.state] is design.state
            verdicts = Counter(
                d.verdict for d in session.scalars(select(DesignRow).where(DesignRow.study_id == study.id))
            )
            counted = {
                Verdict.FEASIBLE: study.feasible,
                Verdict.UNFEASIBLE: study.unfeasible,
                Verdict.ERROR: study.error,
            }
            assert all(verdicts[verdict] == n for verdict, n in counted.items())


DESIGN_OF = {
    JobState.QUEUED: DesignState.WAITING,
    JobState.RUNNING: DesignState.RUNNING,
    JobState.DONE: DesignState.COMPLETE,
    JobState.FAILED: DesignState.FAILED,
    JobState.CANCELLED: DesignState.CANCELLED,
}


class JobStore(RuleBasedStateMachine):
    """Jobs are made, told of, claimed, lost and ended in any order; workers keep leases that are long lost."""

    database: Database
    job_ids = Bundle("job_ids")
    leases = Bundle("leases")

    def __init__(self) -> None:
        super().__init__()
        empty(self.database)

    @rule(target=job_ids)
    def create(self) -> str:
        return a_simulate_job(self.database)[1]

    @rule(job_id=job_ids)
    def publish(self, job_id: str) -> None:
        with self.database.writing() as session:
            queries.mark_published(session, [job_id])

    @rule()
    def lose_all_messages(self) -> None:
        with self.database.writing() as session:
            queries.forget_publications(session)

    @rule(target=leases, job_id=job_ids, times=st.integers(0, 3))
    def deliver(self, job_id: str, times: int) -> Any:
        won = []
        for n in range(times):
            with self.database.writing() as session:
                claim = claim_job(session, job_id, f"worker-{n}", LEASE_S)
            if claim is not None:
                won.append(claim.lease)
        assert len(won) <= 1
        return multiple(*won)

    @rule(lease=leases)
    def beat(self, lease: Lease) -> None:
        owned = self._is_owner(lease)
        with self.database.writing() as session:
            assert (queries.beat(session, lease, LEASE_S, {"fraction": 0.5}) is not None) is owned

    @rule(job_id=job_ids)
    def crash_or_freeze(self, job_id: str) -> None:
        """Its worker is silent for its whole lease; it may come back with the lease that it still holds."""
        self._move_lease(job_id, -1.0)

    @rule(job_id=job_ids, seconds=st.sampled_from([-10_800.0, 10_800.0]))
    def jump_the_clock(self, job_id: str, seconds: float) -> None:
        """Of the leases: as if the machine had started anew since."""
        self._move_lease(job_id, seconds)

    def _move_lease(self, job_id: str, seconds: float) -> None:
        with self.database.writing() as session:
            session.execute(
                update(JobRow)
                .where(JobRow.id == job_id, JobRow.state == JobState.RUNNING)
                .values(lease_until=lease_now() + seconds)
            )

    @rule()
    def reap(self) -> None:
        reap_all(self.database)
        with self.database.reading() as session:
            assert not queries.expired(session)

    @rule(lease=leases)
    def come_back_late(self, lease: Lease) -> None:
        """A worker that lives gives up what it holds, or says of what was taken from it that it was late."""
        with self.database.writing() as session:
            forgive_attempt(session, lease)
            assert not queries.holds(session, lease)

    @rule(job_id=job_ids)
    def cancel(self, job_id: str) -> None:
        try:
            with self.database.writing() as session:
                cancel_job(session, job_id)
        except JobNotCancellable:
            with self.database.reading() as session:
                assert is_over(session.get_one(JobRow, job_id).state)

    @rule(
        lease=leases, how=st.sampled_from(["done", "failed", "cancelled", "released", "disk full", "memory"])
    )
    def finish(self, lease: Lease, how: str) -> None:
        owned = self._is_owner(lease)
        with self.database.writing() as session:
            if how == "done":
                written = record_measurement(session, lease, a_measurement())
            elif how == "failed":
                written = record_failure(session, lease, Failure(FailureClass.ERROR, "broken"))
            elif how == "cancelled":
                written = record_cancellation(session, lease)
            elif how == "released":
                written = give_back_job(session, lease, Return("released", "stopped"))
            elif how == "disk full":
                written = give_back_job(session, lease, Return("disk_full", "full", pause_s=0.001))
            else:
                row = session.get_one(JobRow, lease.job_id)
                left = row.max_attempts - row.attempt
                if left <= 0 and owned:  # then it is a failure: worker.recovery.retry_of
                    return
                written = give_back_job(session, lease, Return("out_of_memory", "", counts=True))
        assert written is owned, "who owns the job writes, nobody else"

    def _is_owner(self, lease: Lease) -> bool:
        with self.database.reading() as session:
            return queries.holds(session, lease)

    @invariant()
    def everything_agrees(self) -> None:
        check_invariants(self.database)


def empty(database: Database) -> None:
    tables = [table.name for table in reversed(Base.metadata.sorted_tables)]
    with database.writing() as session:
        if database.engine.dialect.name == "postgresql":
            session.execute(text(f"truncate {', '.join(tables)} restart identity cascade"))
        else:
            for name in tables:
                session.execute(text(f"delete from {name}"))


def run_machine(database: Database, examples: int, steps: int) -> None:
    class OnThis(JobStore):
        pass

    OnThis.database = database
    run_state_machine_as_test(
        OnThis,
        settings=settings(
            max_examples=examples,
            stateful_step_count=steps,
            deadline=None,
            database=None,
            derandomize=True,
            suppress_health_check=list(HealthCheck),
        ),
    )


def test_no_order_of_events_loses_or_doubles_a_job(database: Database) -> None:
    run_machine(database, examples=6, steps=15)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_no_order_of_many_events_loses_or_doubles_a_job(database: Database) -> None:
    run_machine(database, examples=150, steps=40)


STEPS = ("claim", "beat", "finish")


def interleavings() -> Iterator[tuple[tuple[int, str], ...]]:
    """All orders of two workers' steps on one job, each worker's own in order, with one lost lease anywhere."""
    for places in itertools.combinations(range(6), 3):
        order = [0 if n in places else 1 for n in range(6)]
        for lost_after in range(6):
            steps, taken = list[tuple[int, str]](), [0, 0]
            for n, worker in enumerate(order):
                steps.append((worker, STEPS[taken[worker]]))
                taken[worker] += 1
                if n == lost_after:
                    steps.append((2, "lease runs out"))
            yield tuple(steps)


def test_every_interleaving_of_two_workers_on_one_job_finishes_it_at_most_once(
    sqlite_database: Database,
) -> None:
    """120 orders; where both wrote or none could, the store would be wrong."""
    orders = list(interleavings())
    assert len(orders) == 20 * 6
    for order in orders:
        _, job_id = a_simulate_job(sqlite_database)
        play(sqlite_database, job_id, order)
    check_invariants(sqlite_database)


def play(database: Database, job_id: str, order: tuple[tuple[int, str], ...]) -> None:
    held: list[Lease | None] = [None, None]
    written = 0
    for worker, step in order:
        if step == "lease runs out":
            let_lease_expire(database, job_id)
            reap_all(database)
            continue
        lease = held[worker]
        with database.writing() as session:
            if step == "claim":
                claim = claim_job(session, job_id, f"worker-{worker}", LEASE_S)
                held[worker] = None if claim is None else claim.lease
            elif lease is not None and step == "beat":
                queries.beat(session, lease, LEASE_S, None)
            elif lease is not None:
                written += record_measurement(session, lease, a_measurement(20.0 + worker))
    assert written <= 1, order
    with database.reading() as session:
        row = session.get_one(JobRow, job_id)
        assert (row.state is JobState.DONE) == (written == 1), order
        assert is_over(row.state) or row.state in (JobState.QUEUED, JobState.RUNNING)

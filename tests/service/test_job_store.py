"""The job store's promises, on both databases: one owner at a time, nothing lost, nothing done twice."""

from __future__ import annotations

import threading

import pytest
from sqlalchemy import select, update
from sqlalchemy.exc import IntegrityError

from service.db import queries
from service.db.clock import database_now
from service.db.models import JobRow, RunRow
from service.db.queries import Lease
from service.db.session import Database
from service.domain.outcome import Failure, FailureClass
from service.domain.states import DesignState, JobKind, JobState, StudyState, Verdict
from service.studies.advance_study import add_job
from service.studies.cancel_job import JobNotCancellable, cancel_job
from service.studies.cancel_study import cancel_study
from service.studies.claim_job import claim_job
from service.studies.give_back_job import Return, give_back_job
from service.studies.reap_job import reap_job
from service.studies.record_cancellation import record_cancellation
from service.studies.record_failure import record_failure
from service.studies.record_measurement import record_measurement
from tests.builders.studies import (
    LEASE_S,
    a_measurement,
    a_proposal,
    a_simulate_job,
    a_study,
    claimed,
    designs,
    event_kinds,
    job,
    let_lease_expire,
    open_jobs,
    propose_next,
    study,
)


def finish(database: Database, lease: Lease, angle_deg: float = 25.4) -> bool:
    with database.writing() as session:
        return record_measurement(session, lease, a_measurement(angle_deg))


def reap_all(database: Database) -> list[JobState | None]:
    with database.reading() as session:
        expired = queries.expired(session)
    states = []
    for lease in expired:
        with database.writing() as session:
            states.append(reap_job(session, lease))
    return states


def exit_classes(database: Database, job_id: str) -> list[str | None]:
    with database.reading() as session:
        runs = select(RunRow.exit_class).where(RunRow.job_id == job_id).order_by(RunRow.attempt)
        return list(session.scalars(runs))


def test_the_databases_clock_is_seconds_since_1970(database: Database) -> None:
    import time

    with database.reading() as session:
        assert queries.now(session) == pytest.approx(time.time(), abs=2.0)


def test_a_second_message_for_a_claimed_job_is_dropped(database: Database) -> None:
    _, job_id = a_simulate_job(database)
    claimed(database, job_id, "worker-a")
    with database.writing() as session:
        assert claim_job(session, job_id, "worker-b", LEASE_S) is None
    assert job(database, job_id).worker_id == "worker-a"
    assert job(database, job_id).attempt == 1


def test_a_message_for_a_finished_or_an_unknown_job_is_dropped(database: Database) -> None:
    _, job_id = a_simulate_job(database)
    assert finish(database, claimed(database, job_id).lease)
    for message in (job_id, "00000000-0000-0000-0000-000000000000", "not even an id"):
        with database.writing() as session:
            assert claim_job(session, message, "worker-b", LEASE_S) is None


def test_of_many_claims_at_once_exactly_one_wins(database: Database) -> None:
    _, job_id = a_simulate_job(database)
    barrier, winners = threading.Barrier(8), list[str]()

    def try_to_claim(name: str) -> None:
        barrier.wait()
        with database.writing() as session:
            if claim_job(session, job_id, name, LEASE_S) is not None:
                winners.append(name)

    threads = [threading.Thread(target=try_to_claim, args=(f"worker-{n}",)) for n in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(winners) == 1
    assert job(database, job_id).worker_id == winners[0]
    assert exit_classes(database, job_id) == [None]


def test_a_beat_extends_the_lease_and_brings_the_cancel_flag(database: Database) -> None:
    _, job_id = a_simulate_job(database)
    lease = claimed(database, job_id, lease_s=1.0).lease
    before = job(database, job_id).lease_until
    with database.writing() as session:
        assert queries.beat(session, lease, 60.0, {"fraction": 0.5}) is False
    stored = job(database, job_id)
    assert before is not None
    assert stored.lease_until is not None
    assert stored.lease_until > before + 50.0
    assert stored.progress == {"fraction": 0.5}
    with database.writing() as session:
        cancel_job(session, job_id)
    with database.writing() as session:
        assert queries.beat(session, lease, 60.0, None) is True
    assert job(database, job_id).progress == {"fraction": 0.5}


def test_a_worker_that_lost_its_lease_writes_nothing(database: Database) -> None:
    study_id, job_id = a_simulate_job(database)
    old = claimed(database, job_id, "frozen").lease
    let_lease_expire(database, job_id)
    assert reap_all(database) == [JobState.QUEUED]
    new = claimed(database, job_id, "next").lease
    events = event_kinds(database, study_id)
    failure = Failure(FailureClass.ERROR, "late")
    with database.writing() as session:
        assert queries.beat(session, old, LEASE_S, {"fraction": 0.9}) is None
        assert not record_measurement(session, old, a_measurement(10.0))
        assert not record_failure(session, old, failure)
        assert not record_cancellation(session, old)
        assert not give_back_job(session, old, Return("released", ""))
    assert event_kinds(database, study_id) == events
    assert designs(database, study_id)[0].angle_deg is None
    assert job(database, job_id).worker_id == "next"
    assert finish(database, new)
    assert designs(database, study_id)[0].angle_deg == 25.4
    assert study(database, study_id).feasible == 1


def test_a_lease_that_ran_out_but_was_not_reaped_may_still_finish(database: Database) -> None:
    study_id, job_id = a_simulate_job(database)
    lease = claimed(database, job_id).lease
    let_lease_expire(database, job_id)
    assert finish(database, lease)
    assert reap_all(database) == []
    assert designs(database, study_id)[0].state is DesignState.COMPLETE


def test_the_reaper_leaves_living_leases_alone(database: Database) -> None:
    _, job_id = a_simulate_job(database)
    lease = claimed(database, job_id).lease
    with database.writing() as session:
        assert reap_job(session, lease) is None
    assert reap_all(database) == []


def test_a_lost_job_is_queued_again_and_wants_a_new_message(database: Database) -> None:
    study_id, job_id = a_simulate_job(database)
    with database.writing() as session:
        queries.mark_published(session, [job_id])
    claimed(database, job_id)
    let_lease_expire(database, job_id)
    assert reap_all(database) == [JobState.QUEUED]
    assert designs(database, study_id)[0].state is DesignState.WAITING
    assert exit_classes(database, job_id) == ["lost"]
    with database.reading() as session:
        assert (job_id, JobKind.SIMULATE) in queries.to_publish(session)


def test_a_job_that_kills_every_worker_fails_as_lost_and_the_study_goes_on(database: Database) -> None:
    study_id, job_id = a_simulate_job(database, parallel=1)
    for expected in (JobState.QUEUED, JobState.QUEUED, JobState.FAILED):
        claimed(database, job_id)
        let_lease_expire(database, job_id)
        assert reap_all(database) == [expected]
    (design,) = designs(database, study_id)
    assert (design.state, design.verdict) == (DesignState.FAILED, Verdict.ERROR)
    assert design.failure_class == "lost"
    assert study(database, study_id).error == 1
    assert exit_classes(database, job_id) == ["lost", "lost", "lost"]
    assert len(open_jobs(database, study_id, JobKind.PROPOSE)) == 1


def test_an_orderly_return_uses_up_no_attempt(database: Database) -> None:
    study_id, job_id = a_simulate_job(database)
    for _ in range(5):
        lease = claimed(database, job_id).lease
        with database.writing() as session:
            assert give_back_job(session, lease, Return("released", "the worker stops"))
    stored = job(database, job_id)
    assert (stored.state, stored.attempt, stored.max_attempts) == (JobState.QUEUED, 5, 8)
    assert designs(database, study_id)[0].state is DesignState.WAITING
    assert exit_classes(database, job_id) == ["released"] * 5


def test_a_blow_up_is_repeated_with_half_the_time_step(database: Database) -> None:
    _, job_id = a_simulate_job(database)
    lease = claimed(database, job_id).lease
    with database.writing() as session:
        give_back_job(session, lease, Return("blow_up", "overlap", time_step_factor=0.5))
    assert claimed(database, job_id).time_step_factor == 0.5
    with database.reading() as session:
        factors = select(RunRow.time_step_factor).where(RunRow.job_id == job_id).order_by(RunRow.attempt)
        assert list(session.scalars(factors)) == [1.0, 0.5]


def test_cancelling_a_queued_job_ends_it_now(database: Database) -> None:
    study_id, job_id = a_simulate_job(database)
    with database.writing() as session:
        cancel_job(session, job_id)
    assert job(database, job_id).state is JobState.CANCELLED
    assert designs(database, study_id)[0].state is DesignState.CANCELLED
    assert designs(database, study_id)[0].verdict is None
    with database.writing() as session:
        assert claim_job(session, job_id, "worker", LEASE_S) is None


def test_a_running_job_that_is_cancelled_and_lost_is_not_started_again(database: Database) -> None:
    study_id, job_id = a_simulate_job(database)
    claimed(database, job_id)
    with database.writing() as session:
        cancel_job(session, job_id)
    let_lease_expire(database, job_id)
    assert reap_all(database) == [JobState.CANCELLED]
    assert designs(database, study_id)[0].state is DesignState.CANCELLED


def test_a_cancelled_job_that_is_given_back_is_cancelled_and_not_stuck_in_the_queue(
    database: Database,
) -> None:
    study_id, job_id = a_simulate_job(database)
    lease = claimed(database, job_id).lease
    with database.writing() as session:
        cancel_job(session, job_id)
    with database.writing() as session:
        assert give_back_job(session, lease, Return("released", "the worker stops"))
    assert job(database, job_id).state is JobState.CANCELLED
    assert designs(database, study_id)[0].state is DesignState.CANCELLED


def test_cancelling_twice_is_fine_and_cancelling_what_is_done_is_refused(database: Database) -> None:
    _, job_id = a_simulate_job(database)
    for _ in range(2):
        with database.writing() as session:
            row = cancel_job(session, job_id)
            assert row is not None
            assert row.state is JobState.CANCELLED
    _, done_id = a_simulate_job(database)
    assert finish(database, claimed(database, done_id).lease)
    with database.writing() as session, pytest.raises(JobNotCancellable, match="done already"):
        cancel_job(session, done_id)


def test_a_propose_job_cannot_be_cancelled_alone(database: Database) -> None:
    (job_id,) = open_jobs(database, a_study(database))
    with database.writing() as session, pytest.raises(JobNotCancellable, match="cancel study"):
        cancel_job(session, job_id)


def test_a_design_has_one_open_job_and_a_study_one_open_proposal(database: Database) -> None:
    study_id, job_id = a_simulate_job(database)
    design_id = job(database, job_id).design_id
    with pytest.raises(IntegrityError), database.writing() as session:
        add_job(session, study_id, JobKind.SIMULATE, design_id)
    with pytest.raises(IntegrityError), database.writing() as session:
        add_job(session, study_id, JobKind.PROPOSE)


def test_the_same_design_twice_is_refused_but_another_seed_is_a_replicate(database: Database) -> None:
    study_id = a_study(database, parallel=3)
    propose_next(database, study_id, a_proposal(1))
    propose_next(database, study_id, a_proposal(1, seed=2, origin="replicate"))
    with pytest.raises(IntegrityError):
        propose_next(database, study_id, a_proposal(1))
    assert [d.number for d in designs(database, study_id)] == [1, 2]


def test_unpublished_jobs_come_first_and_silent_ones_again(database: Database) -> None:
    _, job_id = a_simulate_job(database)

    def waiting() -> list[str]:
        with database.reading() as session:
            return [found for found, _ in queries.to_publish(session)]

    def publish_seconds_ago(seconds: float) -> None:
        with database.writing() as session:
            session.execute(
                update(JobRow).where(JobRow.id == job_id).values(published_at=database_now() - seconds)
            )

    assert job_id in waiting()
    with database.writing() as session:
        queries.mark_published(session, [job_id])
    assert job_id not in waiting()
    publish_seconds_ago(queries.REPUBLISH_AFTER_S + 1.0)
    assert job_id in waiting()
    with database.writing() as session:
        queries.mark_published(session, [job_id])
    publish_seconds_ago(queries.REPUBLISH_AFTER_S * 4 - 1.0)
    assert job_id not in waiting(), "the second silence is given four times as long"
    publish_seconds_ago(-3600.0)
    assert job_id in waiting(), "a clock that jumped back does not silence a job"


def test_a_cancelled_study_ends_when_its_running_jobs_have(database: Database) -> None:
    study_id = a_study(database, parallel=2)
    propose_next(database, study_id)
    propose_next(database, study_id)
    first, second = open_jobs(database, study_id, JobKind.SIMULATE)
    lease = claimed(database, first).lease
    with database.writing() as session:
        cancel_study(session, study_id)
    assert job(database, second).state is JobState.CANCELLED
    assert study(database, study_id).state is StudyState.CANCELLING
    with database.writing() as session:
        assert record_cancellation(session, lease)
    assert [job(database, j).kind for j in open_jobs(database, study_id)] == [JobKind.RECOMMEND]


def test_a_study_without_designs_is_cancelled_at_once(database: Database) -> None:
    study_id = a_study(database)
    with database.writing() as session:
        cancel_study(session, study_id)
    assert study(database, study_id).state is StudyState.CANCELLED
    assert open_jobs(database, study_id) == []
    assert event_kinds(database, study_id) == ["study_created", "study_stopping", "study_finished"]


def test_a_proposal_that_fails_ends_the_study_and_takes_its_jobs_back(database: Database) -> None:
    study_id = a_study(database, parallel=2)
    propose_next(database, study_id)
    (simulate_id,) = open_jobs(database, study_id, JobKind.SIMULATE)
    (propose_id,) = open_jobs(database, study_id, JobKind.PROPOSE)
    lease = claimed(database, propose_id).lease
    with database.writing() as session:
        assert record_failure(session, lease, Failure(FailureClass.ERROR, "singular matrix"))
    ended = study(database, study_id)
    assert ended.state is StudyState.FAILED
    assert ended.stop_text is not None
    assert "singular matrix" in ended.stop_text
    assert job(database, simulate_id).state is JobState.CANCELLED


def test_a_proposal_for_a_study_that_was_cancelled_meanwhile_adds_no_design(database: Database) -> None:
    from service.studies.record_proposal import record_proposal

    study_id = a_study(database)
    (propose_id,) = open_jobs(database, study_id, JobKind.PROPOSE)
    lease = claimed(database, propose_id).lease
    with database.writing() as session:
        cancel_study(session, study_id)
    with database.writing() as session:
        assert record_proposal(session, lease, a_proposal(1))
    assert designs(database, study_id) == []
    assert study(database, study_id).state is StudyState.CANCELLED


def test_parallel_writers_wait_for_each_other_instead_of_failing(database: Database) -> None:
    """A plain BEGIN on SQLite gives "database is locked" here."""
    ids = [a_simulate_job(database) for _ in range(6)]
    errors = list[Exception]()

    def work(job_id: str) -> None:
        try:
            lease = claimed(database, job_id).lease
            for step in range(10):
                with database.writing() as session:
                    assert queries.beat(session, lease, LEASE_S, {"step": step}) is False
            assert finish(database, lease)
        except Exception as error:  # noqa: BLE001 (a thread's failure is looked at below)
            errors.append(error)

    threads = [threading.Thread(target=work, args=(job_id,)) for _, job_id in ids]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    assert all(study(database, study_id).feasible == 1 for study_id, _ in ids)

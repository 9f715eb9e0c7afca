"""A worker that was late for its lease and comes back: the attempt does not count, on both databases."""

from __future__ import annotations

from service.db.queries import Lease
from service.db.session import Database
from service.domain.states import DesignState, JobState
from service.studies.advance_study import ATTEMPTS
from service.studies.forgive_attempt import MOST_FORGIVEN, forgive_attempt
from tests.builders.studies import a_simulate_job, claimed, designs, job, let_lease_expire
from tests.service.test_job_store import exit_classes, finish, reap_all


def lose_to_the_reaper(database: Database, job_id: str) -> Lease:
    """An attempt whose worker beats too late."""
    lease = claimed(database, job_id).lease
    let_lease_expire(database, job_id)
    reap_all(database)
    return lease


def forgive(database: Database, lease: Lease) -> bool:
    with database.writing() as session:
        return forgive_attempt(session, lease)


def test_a_machine_that_stalls_loses_no_job_however_often(database: Database) -> None:
    """Its workers are late, not dead: it loses more leases than it has attempts, and is done all the same."""
    study_id, job_id = a_simulate_job(database)
    for _ in range(2 * ATTEMPTS):
        assert forgive(database, lose_to_the_reaper(database, job_id))
    assert exit_classes(database, job_id) == ["late"] * 2 * ATTEMPTS
    assert finish(database, claimed(database, job_id).lease)
    assert designs(database, study_id)[0].state is DesignState.COMPLETE


def test_an_attempt_is_forgiven_once_and_only_where_it_was_lost(database: Database) -> None:
    _, job_id = a_simulate_job(database)
    lease = lose_to_the_reaper(database, job_id)
    assert forgive(database, lease)
    assert not forgive(database, lease)
    assert job(database, job_id).max_attempts == ATTEMPTS + 1
    done = claimed(database, job_id).lease
    assert finish(database, done)
    assert not forgive(database, done)
    assert not forgive(database, Lease("no such job", 1))
    assert exit_classes(database, job_id) == ["late", "done"]


def test_a_late_worker_whose_job_nobody_took_gives_it_back_at_once(database: Database) -> None:
    _, job_id = a_simulate_job(database)
    lease = claimed(database, job_id).lease
    let_lease_expire(database, job_id)
    assert forgive(database, lease)
    stored = job(database, job_id)
    assert (stored.state, stored.max_attempts) == (JobState.QUEUED, ATTEMPTS + 1)
    assert exit_classes(database, job_id) == ["late"]


def test_a_job_that_keeps_its_workers_from_beating_ends_all_the_same(database: Database) -> None:
    study_id, job_id = a_simulate_job(database, parallel=1)
    attempts = 0
    while job(database, job_id).state is JobState.QUEUED:
        forgive(database, lose_to_the_reaper(database, job_id))
        attempts += 1
        assert attempts < 100
    assert attempts == MOST_FORGIVEN + ATTEMPTS
    assert designs(database, study_id)[0].failure_class == "lost"

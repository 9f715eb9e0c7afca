"""The heartbeat of a job under way."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable

import pytest
from sqlalchemy.exc import OperationalError

from service.db.session import Database
from service.domain.states import JobState
from service.studies.cancel_job import cancel_job
from service.studies.reap_job import reap_job
from tests.builders.studies import a_simulate_job, claimed, job, let_lease_expire
from worker import process
from worker.process import Attempt, Shutdown, StopReason

LEASE_S = 0.8


def wait_until(is_true: Callable[[], bool], seconds: float = 5.0) -> float:
    """Seconds until it was true."""
    start = time.monotonic()
    while not is_true():
        assert time.monotonic() - start < seconds, "it never became true"
        time.sleep(0.01)
    return time.monotonic() - start


@pytest.fixture(autouse=True)
def no_shutdown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "shutdown", Shutdown())


def test_the_lease_outlives_its_first_length(database: Database) -> None:
    _, job_id = a_simulate_job(database)
    lease = claimed(database, job_id, lease_s=LEASE_S).lease
    with Attempt(database, lease, LEASE_S) as attempt:
        time.sleep(2 * LEASE_S)
        with database.writing() as session:
            assert reap_job(session, lease) is None
        assert attempt.stop is None
    assert job(database, job_id).state is JobState.RUNNING


def test_progress_reaches_the_row(database: Database) -> None:
    _, job_id = a_simulate_job(database)
    lease = claimed(database, job_id, lease_s=LEASE_S).lease
    with Attempt(database, lease, LEASE_S) as attempt:
        assert attempt.report({"fraction": 0.25})
        wait_until(lambda: job(database, job_id).progress == {"fraction": 0.25})


def test_a_cancellation_is_seen_within_a_second(database: Database) -> None:
    _, job_id = a_simulate_job(database)
    lease = claimed(database, job_id, lease_s=LEASE_S).lease
    with Attempt(database, lease, LEASE_S) as attempt:
        with database.writing() as session:
            cancel_job(session, job_id)
        assert wait_until(lambda: attempt.stop is StopReason.CANCELLED) < 1.0
        assert not attempt.report({"fraction": 0.5})


def test_a_taken_over_job_is_noticed(database: Database) -> None:
    _, job_id = a_simulate_job(database)
    lease = claimed(database, job_id, lease_s=60.0).lease
    let_lease_expire(database, job_id)
    with database.writing() as session:
        reap_job(session, lease)
    claimed(database, job_id, "other")
    with Attempt(database, lease, LEASE_S) as attempt:
        wait_until(lambda: attempt.stop is StopReason.FENCED)
        assert not attempt.report({})
    assert job(database, job_id).worker_id == "other"


def test_a_database_that_is_away_for_a_whole_lease_stops_the_work_but_not_sooner(
    sqlite_database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, job_id = a_simulate_job(sqlite_database)
    lease = claimed(sqlite_database, job_id, lease_s=LEASE_S).lease

    def away(*_: object) -> None:
        raise OperationalError("update jobs", {}, Exception("connection refused"))

    with Attempt(sqlite_database, lease, LEASE_S) as attempt:
        monkeypatch.setattr("worker.process.queries.beat", away)
        time.sleep(0.5 * LEASE_S)
        assert attempt.stop is None
        wait_until(lambda: attempt.stop is StopReason.FENCED)


def test_a_shutdown_is_seen_at_once(sqlite_database: Database) -> None:
    _, job_id = a_simulate_job(sqlite_database)
    lease = claimed(sqlite_database, job_id).lease
    with Attempt(sqlite_database, lease, 60.0) as attempt:
        assert attempt.stop is None
        process.shutdown.announce()
        assert attempt.stop is StopReason.SHUTDOWN
        assert not attempt.report({})


def test_the_heartbeat_ends_with_the_attempt(sqlite_database: Database) -> None:
    _, job_id = a_simulate_job(sqlite_database)
    lease = claimed(sqlite_database, job_id).lease
    with Attempt(sqlite_database, lease, LEASE_S):
        assert "heartbeat" in {thread.name for thread in threading.enumerate()}
    assert "heartbeat" not in {thread.name for thread in threading.enumerate()}


def test_a_forked_child_sees_its_parents_shutdown_and_its_parents_death() -> None:
    flag = Shutdown()
    for announce in (True, False):
        ready_read, ready_write = os.pipe()
        said_read, said_write = os.pipe()
        parent = os.fork()
        if parent == 0:
            child_flag = Shutdown() if not announce else flag
            if os.fork() == 0:
                child_flag.watch_parent()
                os.write(ready_write, b"x")
                deadline = time.monotonic() + 5.0
                while not child_flag.is_on and time.monotonic() < deadline:
                    time.sleep(0.01)
                os.write(said_write, b"1" if child_flag.is_on else b"0")
                os._exit(0)
            time.sleep(5.0)
            os._exit(0)
        os.read(ready_read, 1)
        if announce:
            flag.announce()
        else:
            os.kill(parent, signal.SIGKILL)
        assert os.read(said_read, 1) == b"1"
        if announce:
            os.kill(parent, signal.SIGKILL)
        os.waitpid(parent, 0)
        for descriptor in (ready_read, ready_write, said_read, said_write):
            os.close(descriptor)

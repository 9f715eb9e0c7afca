"""A charge as a job: failed, repeated, cancelled, lost, fenced. (The rest: test_charge_resume.py.)"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import pytest

from demcore.errors import BlowUp, Cancelled, NoResult
from service.db import queries
from service.db.models import ChargeRow
from service.domain.outcome import ChargeMeasurement
from service.domain.states import DesignState, JobState
from service.settings import Settings
from service.studies.cancel_job import cancel_job
from service.studies.claim_job import ChargeClaim
from service.studies.reap_job import reap_job
from tests.builders.charges import (
    a_charge_measurement,
    charge,
    charges,
    claimed_charge,
    job_of_charge,
)
from tests.builders.studies import let_lease_expire
from tests.builders.work import InProcessWorker, Report
from worker import charge as worker_charge


def use(monkeypatch: pytest.MonkeyPatch, evaluator: Any) -> None:
    monkeypatch.setattr(worker_charge, "evaluate_charge", evaluator)


def test_a_failure_is_recorded_with_its_class_and_text(
    worker: InProcessWorker, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nothing(*_: object) -> ChargeMeasurement:
        raise NoResult("nothing lies in the hopper")

    use(monkeypatch, nothing)
    (number,) = charges(worker.database)
    worker.work_off()
    row = charge(worker.database, number)
    assert (row.state, row.failure_class) == (DesignState.FAILED, "no_result")
    assert row.failure_text == "nothing lies in the hopper"
    assert job_of_charge(worker.database, number).state is JobState.FAILED


def test_a_blow_up_is_repeated_once_with_half_the_time_step(
    worker: InProcessWorker, monkeypatch: pytest.MonkeyPatch
) -> None:
    factors = list[float]()

    def explode(claim: ChargeClaim, *_: object) -> ChargeMeasurement:
        factors.append(claim.time_step_factor)
        if claim.time_step_factor == 1.0:
            raise BlowUp("overlap")
        return a_charge_measurement()

    use(monkeypatch, explode)
    (number,) = charges(worker.database)
    worker.work_off()
    assert factors == [1.0, 0.5]
    assert charge(worker.database, number).state is DesignState.COMPLETE


def test_a_running_charge_is_cancelled(worker: InProcessWorker, monkeypatch: pytest.MonkeyPatch) -> None:
    def until_stopped(claim: ChargeClaim, report: Report, _settings: Settings) -> ChargeMeasurement:
        with worker.database.writing() as session:
            assert cancel_job(session, claim.lease.job_id)
        deadline = time.monotonic() + 10.0
        while report({"fraction": 0.5}):
            assert time.monotonic() < deadline, "nobody stopped it"
            time.sleep(0.01)
        raise Cancelled("stopped on request")

    use(monkeypatch, until_stopped)
    (number,) = charges(worker.database)
    worker.work_off()
    assert charge(worker.database, number).state is DesignState.CANCELLED
    assert job_of_charge(worker.database, number).state is JobState.CANCELLED


def test_a_charge_whose_worker_vanished_is_queued_again_and_fails_at_the_last_attempt(
    worker: InProcessWorker,
) -> None:
    (number,) = charges(worker.database)
    states: list[tuple[JobState | None, DesignState]] = []
    for _ in range(3):
        claim = claimed_charge(worker.database, number)
        let_lease_expire(worker.database, claim.lease.job_id)
        with worker.database.writing() as session:
            (lease,) = queries.expired(session)
            states.append((reap_job(session, lease), DesignState.WAITING))
            states[-1] = (states[-1][0], charge_state(session, number))
    assert states == [(JobState.QUEUED, DesignState.WAITING)] * 2 + [(JobState.FAILED, DesignState.FAILED)]
    assert charge(worker.database, number).failure_class == "lost"


def charge_state(session: Any, number: int) -> DesignState:
    row = queries.lock_task(session, ChargeRow, number)
    assert row is not None
    return row.state


def test_a_result_that_comes_after_the_lease_was_lost_is_discarded(
    worker: InProcessWorker, monkeypatch: pytest.MonkeyPatch
) -> None:
    def late(claim: ChargeClaim, _report: Report, _settings: Settings) -> ChargeMeasurement:
        let_lease_expire(worker.database, claim.lease.job_id)
        with worker.database.writing() as session:
            reap_job(session, claim.lease)
        return a_charge_measurement()

    use(monkeypatch, late)
    (number,) = charges(worker.database)
    worker.perform(job_of_charge(worker.database, number).id)
    row = charge(worker.database, number)
    assert (row.state, row.results) == (DesignState.WAITING, None)


def test_a_charge_is_published_beside_a_paused_studys_jobs(worker: InProcessWorker) -> None:
    (number,) = charges(worker.database)
    with worker.database.reading() as session:
        published: Mapping[str, Any] = dict(queries.to_publish(session))
    assert list(published) == [job_of_charge(worker.database, number).id]

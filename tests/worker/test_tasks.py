"""What a task records, whatever happens while it works."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import pytest
from sqlalchemy import select

from demcore.errors import BlowUp, Cancelled, NoResult
from service.db.models import RunRow
from service.db.session import Database
from service.domain.outcome import PileMeasurement
from service.domain.states import DesignState, JobState, StudyState, Verdict
from service.settings import Settings
from service.studies.cancel_job import cancel_job
from service.studies.claim_job import Claim
from service.studies.reap_job import reap_job
from service.studies.resume_study import resume_study
from tests.builders.studies import (
    a_measurement,
    a_simulate_job,
    a_study,
    claimed,
    designs,
    event_kinds,
    job,
    let_lease_expire,
    open_jobs,
    study,
)
from tests.builders.work import InProcessWorker, Report
from worker import evaluate, optimize, process


def runs(database: Database, job_id: str) -> list[RunRow]:
    with database.reading() as session:
        found = select(RunRow).where(RunRow.job_id == job_id).order_by(RunRow.attempt)
        return list(session.scalars(found))


def until_stopped(_claim: Claim, report: Report, _settings: Settings) -> PileMeasurement:
    """A simulation that only ends when it is told to."""
    deadline = time.monotonic() + 10.0
    while report({"fraction": 0.5}):
        assert time.monotonic() < deadline, "nobody stopped it"
        time.sleep(0.01)
    raise Cancelled("stopped on request")


def test_a_result_with_its_cost(worker: InProcessWorker) -> None:
    study_id, job_id = a_simulate_job(worker.database)
    worker.perform(job_id)
    (design,) = designs(worker.database, study_id)
    assert design.state is DesignState.COMPLETE
    (run,) = runs(worker.database, job_id)
    assert run.exit_class == "done"
    assert run.worker_id == process.worker_id
    assert run.wall_s is not None
    assert run.memory_mb is not None
    assert run.memory_mb > 10.0
    assert run.code_version is not None


def test_a_doubled_message_does_nothing(worker: InProcessWorker) -> None:
    study_id, job_id = a_simulate_job(worker.database)
    worker.perform(job_id)
    events = event_kinds(worker.database, study_id)
    worker.perform(job_id)
    assert event_kinds(worker.database, study_id) == events
    assert len(runs(worker.database, job_id)) == 1


def test_a_failure_is_recorded_with_its_class_and_text(worker: InProcessWorker) -> None:
    def no_pile(*_: object) -> PileMeasurement:
        raise NoResult("nothing lies on the base")

    worker.evaluate_by(no_pile)
    study_id, job_id = a_simulate_job(worker.database)
    worker.perform(job_id)
    (design,) = designs(worker.database, study_id)
    assert (design.state, design.verdict) == (DesignState.FAILED, Verdict.ERROR)
    assert (design.failure_class, design.failure_text) == ("no_result", "nothing lies on the base")
    assert design.angle_deg is None
    assert job(worker.database, job_id).state is JobState.FAILED


def test_a_blow_up_is_repeated_once_with_half_the_time_step(worker: InProcessWorker) -> None:
    factors = list[float]()

    def explode(claim: Claim, _report: Report, _settings: Settings) -> PileMeasurement:
        factors.append(claim.time_step_factor)
        raise BlowUp("overlap")

    worker.evaluate_by(explode)
    study_id, job_id = a_simulate_job(worker.database, parallel=1)
    worker.perform(job_id)
    worker.perform(job_id)
    worker.perform(job_id)
    assert factors == [1.0, 0.5]
    assert designs(worker.database, study_id)[0].failure_class == "blow_up"
    assert [(run.exit_class, run.time_step_factor) for run in runs(worker.database, job_id)] == [
        ("blow_up", 1.0),
        ("blow_up", 0.5),
    ]


def test_a_design_that_runs_with_half_the_time_step_is_complete(worker: InProcessWorker) -> None:
    def explode_once(claim: Claim, _report: Report, _settings: Settings) -> PileMeasurement:
        if claim.time_step_factor == 1.0:
            raise BlowUp("overlap")
        return a_measurement(25.2)

    worker.evaluate_by(explode_once)
    study_id, job_id = a_simulate_job(worker.database)
    worker.perform(job_id)
    assert job(worker.database, job_id).state is JobState.QUEUED
    worker.perform(job_id)
    assert designs(worker.database, study_id)[0].verdict is Verdict.FEASIBLE


def test_want_of_memory_is_tried_three_times(worker: InProcessWorker) -> None:
    def too_large(*_: object) -> PileMeasurement:
        raise MemoryError("cannot allocate")

    worker.evaluate_by(too_large)
    study_id, job_id = a_simulate_job(worker.database, parallel=1)
    for _ in range(5):
        worker.perform(job_id)
    assert [run.exit_class for run in runs(worker.database, job_id)] == ["out_of_memory"] * 3
    assert designs(worker.database, study_id)[0].failure_class == "out_of_memory"


def test_a_cancelled_simulation_stops_and_is_recorded(worker: InProcessWorker) -> None:
    study_id, job_id = a_simulate_job(worker.database)

    def cancel_then_run(claim: Claim, report: Report, settings: Settings) -> PileMeasurement:
        with worker.database.writing() as session:
            cancel_job(session, job_id)
        return until_stopped(claim, report, settings)

    worker.evaluate_by(cancel_then_run)
    start = time.monotonic()
    worker.perform(job_id)
    assert time.monotonic() - start < 2.0
    assert designs(worker.database, study_id)[0].state is DesignState.CANCELLED
    assert job(worker.database, job_id).state is JobState.CANCELLED
    assert study(worker.database, study_id).error == 0


def test_a_worker_that_is_stopped_gives_its_job_back(worker: InProcessWorker) -> None:
    study_id, job_id = a_simulate_job(worker.database)

    def shut_down_then_run(claim: Claim, report: Report, settings: Settings) -> PileMeasurement:
        process.shutdown.announce()
        return until_stopped(claim, report, settings)

    worker.evaluate_by(shut_down_then_run)
    worker.perform(job_id)
    stored = job(worker.database, job_id)
    assert (stored.state, stored.published_at, stored.max_attempts) == (JobState.QUEUED, None, 4)
    assert designs(worker.database, study_id)[0].state is DesignState.WAITING
    assert runs(worker.database, job_id)[0].exit_class == "released"


@pytest.mark.parametrize("ends_with", ["result", "error"])
def test_a_worker_that_lost_its_job_while_frozen_discards_what_it_has(
    worker: InProcessWorker, ends_with: str
) -> None:
    study_id, job_id = a_simulate_job(worker.database)

    def freeze(claim: Claim, _report: Report, _settings: Settings) -> PileMeasurement:
        let_lease_expire(worker.database, job_id)
        with worker.database.writing() as session:
            reap_job(session, claim.lease)
        claimed(worker.database, job_id, "other")
        if ends_with == "error":
            raise NoResult("late")
        return a_measurement(99.0)

    worker.evaluate_by(freeze)
    worker.perform(job_id)
    (design,) = designs(worker.database, study_id)
    assert (design.state, design.angle_deg, design.failure_class) == (DesignState.RUNNING, None, None)
    stored = job(worker.database, job_id)
    assert (stored.worker_id, stored.max_attempts) == ("other", 4), "that it was late costs no attempt"
    assert [run.exit_class for run in runs(worker.database, job_id)] == ["late", None]


def test_a_result_that_the_database_refuses_fails_the_design(worker: InProcessWorker) -> None:
    def not_a_number(*_: object) -> PileMeasurement:
        return PileMeasurement(25.4, None, None, {"mass_on_base_kg": float("nan")})

    worker.evaluate_by(not_a_number)
    study_id, job_id = a_simulate_job(worker.database)
    worker.perform(job_id)
    (design,) = designs(worker.database, study_id)
    assert design.state is DesignState.FAILED
    assert design.failure_class == "error"


def test_a_proposal_that_raises_fails_the_study_with_its_text(
    worker: InProcessWorker, monkeypatch: pytest.MonkeyPatch
) -> None:
    def raise_it(*_: object) -> Mapping[str, Any]:
        raise FloatingPointError("the kernel matrix is singular")

    monkeypatch.setattr(optimize, "next_design", raise_it)
    study_id = a_study(worker.database)
    worker.perform(open_jobs(worker.database, study_id)[0])
    ended = study(worker.database, study_id)
    assert ended.state is StudyState.FAILED
    assert "FloatingPointError: the kernel matrix is singular" in str(ended.stop_text)


def test_the_checkpoint_of_a_job_that_is_over_is_removed(worker: InProcessWorker, settings: Settings) -> None:
    _, job_id = a_simulate_job(worker.database)
    path = evaluate.checkpoint_path(job_id, settings)
    path.parent.mkdir()
    other = path.with_name("another-job")
    for file in (path, path.with_name(path.name + ".previous"), other):
        file.write_bytes(b"state")

    def explode_once(claim: Claim, _report: Report, _settings: Settings) -> PileMeasurement:
        if claim.time_step_factor == 1.0:
            raise BlowUp("overlap")
        return a_measurement()

    worker.evaluate_by(explode_once)
    worker.perform(job_id)
    assert path.exists(), "the job is queued again"
    worker.perform(job_id)
    assert list(path.parent.iterdir()) == [other]


def test_a_study_that_crashes_everywhere_pauses_with_its_reason_and_goes_on_when_resumed(
    worker: InProcessWorker,
) -> None:
    """Five failures pause it; after its user resumes it takes five more before it pauses again."""

    def no_pile(*_: object) -> PileMeasurement:
        raise NoResult("nothing lies on the base")

    worker.evaluate_by(no_pile)
    study_id = a_study(worker.database, parallel=1, budget=30)
    worker.work_off()
    paused = study(worker.database, study_id)
    assert (paused.state, paused.pause_reason, paused.error) == (StudyState.PAUSED, "too_many_failures", 5)
    assert "5 of 5 simulations ended in error" in str(paused.pause_text)
    with worker.database.writing() as session:
        resume_study(session, study_id)
    worker.work_off()
    paused = study(worker.database, study_id)
    assert (paused.state, paused.error, paused.failures_forgiven) == (StudyState.PAUSED, 10, 5)
    assert [design.number for design in designs(worker.database, study_id)] == list(range(1, 11))

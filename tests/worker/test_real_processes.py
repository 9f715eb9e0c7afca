"""Broker, dispatcher and worker as real processes, killed and stopped for real."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from sqlalchemy import select

from service import broker
from service.db import read_models
from service.db.migrate import upgrade
from service.db.models import JobRow, ProcessRow
from service.db.session import Database
from service.domain.search_space import default_space
from service.domain.states import JobKind, JobState, StudyState
from service.settings import Settings
from service.studies.add_design import add_design
from service.studies.extend_budget import extend_budget
from service.studies.pause_study import pause_study
from service.studies.resume_study import resume_study
from tests.builders.studies import a_study, designs, open_jobs, study
from tests.builders.work import GATE, InProcessWorker

ROOT = Path(__file__).resolve().parents[2]
SMALL = {"budget": 3, "initial_designs": 3, "parallel": 1}
BY_HAND = dict(zip(default_space().names, (0.5, 0.4, 0.3, 0.2), strict=True))


class Installation:
    """Processes over one data folder."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.database = Database(settings.resolved_database_url)

    @contextmanager
    def process(self, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
        environment = {
            **os.environ,
            "TALUS_DATA_DIR": str(self.settings.data_dir),
            "TALUS_LEASE_SECONDS": str(self.settings.lease_seconds),
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
        }
        log = self.settings.data_dir / "log"
        with log.open("ab") as output:
            started = subprocess.Popen(
                arguments, env=environment, cwd=ROOT, stdout=output, stderr=output, start_new_session=True
            )
        try:
            yield started
        finally:
            # Its children too: a celery child outlives a parent that is killed.
            with suppress(ProcessLookupError):
                os.killpg(started.pid, signal.SIGKILL)
            started.wait()

    def wait_for(self, what: str, is_true: Callable[[], bool], seconds: float = 120.0) -> float:
        start = time.monotonic()
        while not is_true():
            if time.monotonic() - start > seconds:
                pytest.fail(
                    f"{what}: not within {seconds} s\n" + (self.settings.data_dir / "log").read_text()
                )
            time.sleep(0.05)
        return time.monotonic() - start

    def running_simulation(self, study_id: int) -> tuple[str, int] | None:
        """The job that is simulated right now, and the process that does it."""
        statement = (
            select(JobRow.id, ProcessRow.pid)
            .join(ProcessRow, ProcessRow.id == JobRow.worker_id)
            .where(
                JobRow.study_id == study_id,
                JobRow.state == JobState.RUNNING,
                JobRow.kind == JobKind.SIMULATE,
                JobRow.progress.is_not(None),
            )
        )
        with self.database.reading() as session:
            row = session.execute(statement).first()
        return None if row is None else (row[0], row[1])

    def exit_classes(self, job_id: str) -> list[str | None]:
        with self.database.reading() as session:
            return [run.exit_class for run in read_models.runs_of_job(session, job_id)]


WORKER = (
    *(sys.executable, "-m", "celery", "--app", "tests.builders.gated_worker", "worker"),
    *("--pool", "prefork", "--concurrency", "1", "--without-gossip", "--without-mingle"),
)


@pytest.fixture
def database(sqlite_database: Database) -> Database:
    """Where the undisturbed study runs; once is enough."""
    return sqlite_database


@pytest.fixture
def installation(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Installation]:
    settings = Settings(data_dir=tmp_path_factory.mktemp("i"), lease_seconds=1.0)
    upgrade(settings.resolved_database_url)
    broker.prepare_folders(settings)
    found = Installation(settings)
    with (
        found.process(*broker.server_command(settings)),
        found.process(sys.executable, "-m", "service.dispatcher"),
    ):
        yield found
    found.database.dispose()


def use_controls(database: Database, study_id: int) -> None:
    """While design 1 is under way: a design by hand becomes number 2, and one more simulation is paid for."""
    with database.writing() as session:
        assert pause_study(session, study_id)
        assert add_design(session, study_id, BY_HAND)
        assert extend_budget(session, study_id, 4)
        assert resume_study(session, study_id)


def course(database: Database, study_id: int) -> list[tuple[object, ...]]:
    """What a study has come to, without what its hours say."""
    return [(d.number, d.x, d.seed, d.origin, d.angle_deg) for d in designs(database, study_id)]


def test_a_killed_simulation_is_taken_over_and_a_stopped_worker_gives_its_job_back(
    installation: Installation, worker: InProcessWorker
) -> None:
    """One long test, because a worker takes seconds to start. The worker dies in a study that its user pauses,
    gives a design and more budget meanwhile; the study ends as one does in which nothing died."""
    expected_id = a_study(worker.database, **SMALL)
    worker.perform(worker.queued()[0])
    use_controls(worker.database, expected_id)
    worker.work_off()
    expected = course(worker.database, expected_id)
    assert [(row[0], row[3]) for row in expected] == [(1, "doe"), (2, "manual"), (3, "doe"), (4, "model")]
    undisturbed = study(worker.database, expected_id)

    database, gate = installation.database, installation.settings.data_dir / GATE
    study_id = a_study(database, **SMALL)
    with installation.process(*WORKER) as main:
        found = list[tuple[str, int]]()

        def is_simulated() -> bool:
            running = installation.running_simulation(study_id)
            found[:] = [running] if running else []
            return bool(found)

        installation.wait_for("a simulation under way", is_simulated)
        job_id, child = found[0]
        os.kill(child, signal.SIGKILL)
        # The lease is 1 s, a reaper's pass .2 s, a new child and its first beat another second.
        installation.wait_for(
            "somebody else has it", lambda: is_simulated() and found[0] != (job_id, child), seconds=60.0
        )
        assert found[0][0] == job_id
        assert installation.exit_classes(job_id) == ["lost", None]
        use_controls(database, study_id)
        gate.touch()
        installation.wait_for("the study's end", lambda: study(database, study_id).state.value == "completed")
        assert course(database, study_id) == expected
        ended = study(database, study_id)
        for name in (
            "feasible",
            "unfeasible",
            "error",
            "budget",
            "stop_reason",
            "stop_numbers",
            "recommendation",
        ):
            assert getattr(ended, name) == getattr(undisturbed, name), name
        assert ended.feasible + ended.unfeasible + ended.error == 4

        gate.unlink()
        study_id = a_study(database, **SMALL)
        installation.wait_for("another simulation under way", is_simulated)
        main.send_signal(signal.SIGTERM)
        assert main.wait(timeout=60.0) == 0
    (job_id,) = open_jobs(database, study_id)
    assert installation.exit_classes(job_id) == ["released"]
    with database.reading() as session:
        assert session.get_one(JobRow, job_id).state is JobState.QUEUED
        assert read_models.seen_lately(session, "dispatcher", 5.0)
    assert study(database, study_id).state is StudyState.RUNNING

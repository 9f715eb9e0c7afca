"""A worker inside the test's process: its tasks are called, its evaluator is the test's."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select

from service.db.models import JobRow
from service.db.session import Database
from service.domain.outcome import PileMeasurement
from service.domain.states import JobState
from service.settings import Settings
from service.studies.claim_job import Claim
from tests.builders.studies import a_measurement, synthetic_angle
from worker import evaluate, installation, process, tasks

# Simulations of gated_worker.py end once a file of this name lies in the data folder.
GATE = "open"

Report = Callable[[Mapping[str, Any]], bool]
Evaluator = Callable[[Claim, Report, Settings], PileMeasurement]


def synthetic_pile(claim: Claim, _report: Report, _settings: Settings) -> PileMeasurement:
    """An angle that depends on the design and its seed alone."""
    return a_measurement(synthetic_angle(claim.spec, claim.x, claim.seed))


class InProcessWorker:
    """Works off jobs as a Celery child would, one after the other."""

    def __init__(self, database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
        self.database = database
        self._monkeypatch = monkeypatch
        self.evaluate_by(synthetic_pile)

    def evaluate_by(self, evaluator: Evaluator) -> None:
        self._monkeypatch.setattr(evaluate, "evaluate", evaluator)

    def queued(self) -> list[str]:
        with self.database.reading() as session:
            found = select(JobRow.id).where(JobRow.state == JobState.QUEUED)
            return list(session.scalars(found.order_by(JobRow.created_at, JobRow.id)))

    def perform(self, job_id: str) -> None:
        tasks.perform(job_id)

    def work_off(self, choose: Callable[[list[str]], str] = lambda queued: queued[0]) -> int:
        """Until nothing is queued; the number of messages handled."""
        count = 0
        while queued := self.queued():
            self.perform(choose(queued))
            count += 1
        return count


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path, lease_seconds=1.0)


@pytest.fixture
def worker(database: Database, settings: Settings, monkeypatch: pytest.MonkeyPatch) -> InProcessWorker:
    monkeypatch.setattr(installation, "database", lambda: database)
    monkeypatch.setattr(installation, "settings", lambda: settings)
    monkeypatch.setattr(process, "shutdown", process.Shutdown())
    return InProcessWorker(database, monkeypatch)

"""A toy charge for real: stopped on its way and taken up again, it leaves the files of one that was not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from demcore.experiments.charge_case import ChargeTest
from service.db.read_charges import open_charge
from service.db.session import Database
from service.domain.charge import ChargeSpec
from service.domain.charge import charge_test as whole_test
from service.domain.states import DesignState
from service.settings import Settings
from tests.builders.charges import charge, charges, job_of_charge
from tests.builders.work import InProcessWorker
from worker import charge as worker_charge
from worker import process
from worker.evaluate import checkpoint_path


@pytest.fixture
def database(sqlite_database: Database) -> Database:
    """Once is enough."""
    return sqlite_database


def of_short(spec: ChargeSpec, store: Path, time_step_factor: float) -> ChargeTest:
    """The first second of a coarse charge."""
    test = whole_test(spec, store, time_step_factor)
    return replace(test, charge=replace(test.charge, duration=1.0), rest_seconds=3.5)


def files(database: Database, charge_id: int) -> dict[str, str]:
    """sha256 of each artifact by kind."""
    with database.reading() as session:
        view = open_charge(session, charge_id)
        assert view is not None
        return {artifact.kind: artifact.sha256 for artifact in view.artifacts}


@pytest.mark.slow
def test_a_charge_that_was_stopped_on_its_way_leaves_the_files_of_one_that_was_not(
    worker: InProcessWorker, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker_charge, "charge_test", of_short)
    run_charge = worker_charge.run_charge

    def stopped_once(*arguments: Any, **named: Any) -> Any:
        """The worker is told to stop once 2 s are simulated."""
        tell = named["on_progress"]

        def on_progress(progress: Any) -> bool:
            if progress.time_s >= 2.0 and not stops:
                stops.append(progress.time_s)
                process.shutdown.announce()
            return bool(tell(progress))

        return run_charge(*arguments, **{**named, "on_progress": on_progress})

    stops: list[float] = []
    monkeypatch.setattr(worker_charge, "run_charge", stopped_once)
    ids = charges(worker.database, scale=10.0, frame_seconds=0.5)
    job_id = job_of_charge(worker.database, ids[0]).id
    worker.perform(job_id)
    assert stops
    assert charge(worker.database, ids[0]).state is DesignState.WAITING
    assert checkpoint_path(job_id, settings).exists()
    assert settings.series_folder(job_id).is_dir()
    monkeypatch.setattr(process, "shutdown", process.Shutdown())
    worker.perform(job_id)
    ids += charges(worker.database, scale=10.0, frame_seconds=0.5)
    worker.perform(job_of_charge(worker.database, ids[1]).id)
    stopped, whole = (files(worker.database, number) for number in ids)
    assert set(whole) == {kind for kind, _, _ in worker_charge.FILES}
    for kind in ("result", "spheres", "walls", "burden", "charge", "curves", "wear", "plant"):
        assert stopped[kind] == whole[kind], kind
    row = charge(worker.database, ids[0])
    assert row.state is DesignState.COMPLETE
    assert row.results is not None and row.results["findings"]["piles"] >= 0
    assert row.code_version is not None
    assert not checkpoint_path(job_id, settings).exists()
    assert not settings.series_folder(job_id).exists()

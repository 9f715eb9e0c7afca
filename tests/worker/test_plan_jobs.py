"""A plan as a job: from conditions that nobody has measured to what they could show, on the analytic stand-in."""

from __future__ import annotations

from typing import Any

import pytest

from service.db.session import Database
from service.domain.data_set.reading import data_set_from_tables
from service.domain.diagnosis import PlanSpec
from service.domain.states import DesignState
from service.studies import create_diagnosis, store_data_set
from tests.builders.diagnoses import CONDITIONS, a_diagnosis, diagnosis, job_of_diagnosis, tables
from tests.builders.work import InProcessWorker
from worker import diagnose as worker_diagnose
from worker.diagnosis.floor import NO_FLOOR
from worker.diagnosis.stand_in import StandIn

CHARGE = "belt,charge,coke,3000,0\n"
SMALL = {"first_wave": 32}


@pytest.fixture
def database(sqlite_database: Database) -> Database:
    """Once is enough."""
    return sqlite_database


@pytest.fixture(autouse=True)
def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    """In place of the DEM, which has no charges."""
    monkeypatch.setattr(worker_diagnose, "model_of", lambda *_: worker_diagnose.Model(StandIn(), NO_FLOOR))
    for use_case in (create_diagnosis, store_data_set):
        monkeypatch.setattr(use_case, "cannot_simulate", lambda *_: None)


def planned(worker: InProcessWorker, plan: PlanSpec, more: str = "") -> dict[str, Any]:
    texts = {CONDITIONS: tables(held=())[CONDITIONS] + more}
    with worker.database.writing() as session:
        number = store_data_set.store_data_set(session, "plan", data_set_from_tables(texts, planned=True))[
            0
        ].id
    asked = a_diagnosis(worker.database, number, plan=plan, **SMALL)
    worker.perform(job_of_diagnosis(worker.database, asked))
    row = diagnosis(worker.database, asked)
    assert row.state is DesignState.COMPLETE, row.failure_text
    assert row.results is not None
    assert row.verdict == row.results["verdict"] == "plan"
    return row.results


def verdicts(found: dict[str, Any]) -> dict[str, str]:
    return {effect["effect"]: effect["verdict"] for effect in found["effects"]}


def test_a_charge_shows_what_piles_cannot(worker: InProcessWorker) -> None:
    """The belt acts on charges only: piles are silent about it, the candidate adds it."""
    found = planned(worker, PlanSpec(candidates=("belt",)), CHARGE)
    assert verdicts(found)["belt_speed"] == "silent"
    assert [added["condition"] for added in found["adds"]] == ["belt"]
    assert "belt_speed" in found["adds"][0]["nameable"]
    assert "belt adds most" in found["sentences"][-1]
    assert all(e["detectable_from"] is None for e in found["effects"] if e["verdict"] == "silent")


def test_more_observables_and_more_replicates_show_more(worker: InProcessWorker) -> None:
    """The design's own finding: one angle names nothing. More replicates: each amplitude is seen from less."""
    angle = planned(worker, PlanSpec(observables=("repose_angle_deg",)))
    few, many = planned(worker, PlanSpec(replicates=3)), planned(worker, PlanSpec(replicates=30))

    def nameable(found: dict[str, Any]) -> int:
        return sum(v == "nameable" for v in verdicts(found).values())

    assert nameable(angle) < nameable(few) <= nameable(many)
    for less, more in zip(few["effects"], many["effects"], strict=True):
        if less["detectable_from"] is not None:
            assert more["detectable_from"] < less["detectable_from"]

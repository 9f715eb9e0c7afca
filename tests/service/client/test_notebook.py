"""Talus from a notebook, over a real connection: studies, charges and diagnoses, and the three examples."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

from service.client.notebook import NotOverError, Talus
from service.client.rest import RefusedError, ServiceAwayError
from service.db.models import DiagnosisRow
from service.db.session import Database
from service.domain.states import DesignState
from service.settings import Settings, get_settings
from tests.builders.charges import finish_charge
from tests.builders.diagnoses import tables
from tests.builders.server import Server
from tests.builders.web import settings

__all__ = ["settings"]

ROOT = Path(__file__).resolve().parents[3]
PELLET = ROOT / "docs/studies/pellet/study.json"
VERDICT = {
    "verdict": "no_misfit",
    "claims": [],
    "also_possible": [],
    "not_testable": ["belt_speed"],
    "unexplained": [],
    "gain": None,
    "next_measurement": [],
    "limits": [{"effect": "density", "detectable_from": 0.0512, "unit": "1"}],
    "sentences": ["The floor is assumed."],
}


@pytest.fixture
def server(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    found = Server(settings)
    found.start()
    monkeypatch.setenv("TALUS_PORT", str(found.port))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    get_settings.cache_clear()
    yield found
    found.stop()
    get_settings.cache_clear()


@pytest.fixture
def talus(server: Server) -> Iterator[Talus]:
    with Talus() as found:
        yield found


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder of measured tables."""
    place = tmp_path / "measured"
    place.mkdir()
    for name, text in tables().items():
        (place / name).write_text(text)
    return place


def finish_diagnosis(database: Database, number: int) -> None:
    with database.writing() as session:
        row = session.get_one(DiagnosisRow, number)
        row.state, row.verdict, row.results = DesignState.COMPLETE, "no_misfit", VERDICT


def test_a_study_says_what_it_found(talus: Talus, tmp_path: Path) -> None:
    """docs/studies/README.md: 25.4 +- .3 deg, certified, 9 seeds, 30 simulations."""
    study = talus.import_study(PELLET).wait()
    found = study.found
    assert found is not None
    assert (found.response, found.unit, found.certified, found.seeds) == ("angle_deg", "deg", True, 9)
    assert (round(found.mean, 1), round(found.half_width_90, 1)) == (25.4, 0.3)
    assert "25.43 +- 0.28 deg (90 %), certified by 9 seeds" in str(found)
    rows = study.designs()
    assert len(rows) == 30
    assert {"number", "verdict", "rolling_resistance", "angle_deg"} <= set(rows[0])
    written = study.save(tmp_path / "kept")
    assert [path.name for path in written] == ["study.json", "designs.csv", "designs.parquet"]
    assert len(list(csv.DictReader(written[1].open()))) == 30
    assert talus.study(study.id).answer == study.answer
    assert [other.id for other in talus.studies()] == [study.id]
    assert f"{talus.client.base_url}/studies/{study.id}" in study._repr_html_()


def test_a_new_study_waits_for_a_worker_and_can_be_stopped(talus: Talus) -> None:
    study = talus.calibrate("pellet", scale=4.0, budget=3)
    assert (study.state, study.found, study.report()) == ("running", None, None)
    looked: list[str] = []
    with pytest.raises(NotOverError, match=f"studies/{study.id} is running after 0 s"):
        study.wait(seconds=0.0, tell=lambda s: looked.append(s.state))
    assert looked == ["running"]
    assert study.cancel().is_over


def test_a_charge_leaves_findings_and_files(
    talus: Talus, sqlite_database: Database, settings: Settings, tmp_path: Path
) -> None:
    first, second = talus.start_charges("coke", scale=8.0, seeds=[1, 2])
    assert first.findings is None
    assert second.cancel().state == "CANCELLED"
    finish_charge(sqlite_database, first.id, settings)
    assert first.wait().findings is not None
    assert ("piles", "2") in first.rows()
    assert set(first.files()) == {"burden", "wear", "report"}
    assert {path.name for path in first.save(tmp_path / "kept")} == {"burden.png", "wear.png", "report.html"}
    assert [charge.id for charge in talus.charges()] == [second.id, first.id]


def test_a_diagnosis_and_a_plan(talus: Talus, sqlite_database: Database, folder: Path) -> None:
    diagnosis = talus.diagnose(folder, grains=300)
    assert (diagnosis.verdict, diagnosis.sentences, diagnosis.files()) == (None, [], {})
    finish_diagnosis(sqlite_database, diagnosis.id)
    assert diagnosis.wait().verdict == "no_misfit"
    assert diagnosis.sentences[0].startswith("Consistent with the model")
    (folder / "observations.csv").unlink()
    plan = talus.diagnose(folder, plan={"candidates": ["held"]})
    assert plan.answer["spec"]["plan"]["candidates"] == ["held"]
    assert plan.cancel().is_over
    assert [d.id for d in talus.diagnoses()] == [plan.id, diagnosis.id]
    assert talus.diagnosis(plan.id).verdict is None


def test_a_refusal_is_the_services_own_sentence(talus: Talus, server: Server) -> None:
    with pytest.raises(RefusedError, match="budget"):
        talus.calibrate("pellet", budget=0)
    with pytest.raises(RefusedError, match="There is no study 99"):
        talus.study(99)
    server.stop()
    with pytest.raises(ServiceAwayError, match="no service answers at"):
        talus.studies()


@pytest.mark.parametrize("name", ["calibrate", "charge", "diagnose"])
def test_the_examples_run(
    name: str, talus: Talus, sqlite_database: Database, settings: Settings, folder: Path, tmp_path: Path
) -> None:
    """On stored work, so that no simulation is waited for; what they print is checked."""
    talus.import_study(PELLET)
    finish_charge(sqlite_database, talus.start_charges("coke", scale=8.0)[0].id, settings)
    finish_diagnosis(sqlite_database, talus.diagnose(folder).id)
    notebook = nbformat.read(ROOT / f"docs/notebooks/{name}.ipynb", as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells), "kept without outputs"
    NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(tmp_path)}}).execute()
    told = "\n".join(_texts(notebook))
    expected = {
        "calibrate": ["25.43 +- 0.28 deg (90 %), certified by 9 seeds", "30 designs; the nearest one:"],
        "charge": ["seed 1: 2 piles, far 1.5 m of 0.14 m, near 1.0 m of 0.1 m, depressions behind the rod"],
        "diagnose": ["no_misfit", "density: would have been seen from 0.0512", "none: nothing was named"],
    }
    for text in expected[name]:
        assert text in told


def _texts(notebook: nbformat.NotebookNode) -> Iterator[str]:
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            yield output.get("text") or output.get("data", {}).get("text/plain", "")

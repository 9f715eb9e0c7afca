"""What ended in the last day stands on the first page, whatever it was."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import update

from service.db.clock import database_now
from service.db.models import ChargeRow, DiagnosisRow, StudyRow
from service.db.session import Database
from service.domain.effects import library
from service.domain.states import DesignState
from service.settings import Settings
from tests.builders import piles
from tests.builders.charges import charges, finish_charge
from tests.builders.diagnoses import a_data_set, a_diagnosis
from tests.builders.studies import a_study

HOUR_S = 3600.0


def ended_of(client: TestClient) -> str:
    """The card alone, as text without tags."""
    found = re.search(r'<div id="part-ended">(.*?)</section>', client.get("/").text, re.S)
    assert found is not None
    return " ".join(re.sub(r"<[^>]+>", " ", found[1]).split())


def end(
    database: Database, kind: type[StudyRow | ChargeRow | DiagnosisRow], row: int, hours_ago: float
) -> None:
    with database.writing() as session:
        when = database_now() - hours_ago * HOUR_S
        session.execute(update(kind).where(kind.id == row).values(ended_at=when))


def a_verdict(database: Database, verdict: str, effects: tuple[str, ...] = ()) -> int:
    diagnosis_id = a_diagnosis(database, a_data_set(database))
    with database.writing() as session:
        row = session.get_one(DiagnosisRow, diagnosis_id)
        row.state, row.verdict = DesignState.COMPLETE, verdict
        row.results = {"claims": [{"effect": effect} for effect in effects]}
    end(database, DiagnosisRow, diagnosis_id, 0.5)
    return diagnosis_id


def test_the_night_is_told_newest_first(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    study_id = piles.a_finished_study(sqlite_database, certified=True)
    end(sqlite_database, StudyRow, study_id, 3.0)
    (charge_id,) = charges(sqlite_database)
    finish_charge(sqlite_database, charge_id, settings)
    end(sqlite_database, ChargeRow, charge_id, 2.0)
    diagnosis_id = a_verdict(sqlite_database, "named", ("cohesion",))
    running = a_study(sqlite_database)
    text = ended_of(client)
    places = [
        text.index(name) for name in (f"Diagnosis {diagnosis_id}", f"Charge {charge_id}", f"Study {study_id}")
    ]
    assert places == sorted(places)
    assert f"Study {running}" not in text
    assert "25.43° ± 0.39° after" in text and "Certified" in text
    assert re.search(r"as in the plant: [\w ,]+ \(\d of 4 findings\)", text)
    assert library()["cohesion"].what in text


def test_what_ended_the_day_before_is_left_to_the_lists(
    client: TestClient, sqlite_database: Database
) -> None:
    study_id = piles.a_finished_study(sqlite_database, certified=True)
    end(sqlite_database, StudyRow, study_id, 25.0)
    assert ended_of(client) == "Nothing ended in the last 24 hours."


@pytest.mark.parametrize(
    ("course", "told"),
    [
        (lambda database: piles.a_finished_study(database, certified=False), "Not certified"),
        (piles.a_failed_study, "Failed no repose angle after 0 simulations"),
    ],
)
def test_a_study_says_how_it_ended(
    client: TestClient, sqlite_database: Database, course: Callable[[Database], int], told: str
) -> None:
    course(sqlite_database)
    assert told in ended_of(client)


def test_a_diagnosis_without_a_name_says_what_its_verdict_means(
    client: TestClient, sqlite_database: Database
) -> None:
    a_verdict(sqlite_database, "unexplained")
    assert "Something is wrong that no cause of the library explains." in ended_of(client)

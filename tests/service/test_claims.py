"""Claims of a diagnosis that an engineer confirms or withdraws: what is recorded, shown, and refused."""

from __future__ import annotations

from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select

from service.db.models import ClaimCheckRow, DiagnosisRow, ModelVersionRow
from service.db.session import Database
from service.domain.claims import CLAIM, LONGEST_NOTE, STRONG_CLAIM, CheckOutcome, ClaimCheck, JudgedClaim
from service.domain.states import DesignState
from service.studies.check_claim import check_claim
from tests.builders.diagnoses import a_data_set, a_diagnosis
from tests.service.dashboard.test_diagnosis_pages import RESULT
from worker.diagnosis.result import LEVELS

(LIFT,) = RESULT["claims"]
# Named, without a gain on what was held out.
NAMED = {**LIFT, "effect": "density", "class": "density", "level": "named"}


@pytest.fixture
def database(sqlite_database: Database) -> Database:
    """The client's."""
    return sqlite_database


def told(database: Database) -> int:
    """A diagnosis that claims one effect, and names another."""
    number = a_diagnosis(database, a_data_set(database))
    with database.writing() as session:
        row = session.get_one(DiagnosisRow, number)
        row.state, row.verdict = DesignState.COMPLETE, "named"
        row.results = {**RESULT, "claims": [LIFT, NAMED]}
    return number


def checked(client: TestClient, number: int, effect: str, state: str, **body: Any) -> Any:
    return client.post(f"/v1/diagnoses/{number}/claims/{effect}", json={"state": state, **body})


def claims_of(client: TestClient, number: int) -> dict[str, Any]:
    return {claim["effect"]: claim for claim in client.get(f"/v1/diagnoses/{number}").json()["claims"]}


def levels(client: TestClient, number: int) -> dict[str, str]:
    result = client.get(f"/v1/diagnoses/{number}").json()["result"]
    return {claim["effect"]: claim["level"] for claim in result["claims"]}


def test_a_claim_is_proposed_until_it_is_checked(client: TestClient, database: Database) -> None:
    found = claims_of(client, told(database))
    assert found["lift_speed"] == {
        "effect": "lift_speed", "state": "proposed", "level": "claim", "checks": [],
    }  # fmt: skip


def test_a_confirmed_claim_is_a_strong_one(client: TestClient, database: Database) -> None:
    """What is only named does not become one, and what the analyser wrote stays as it wrote it."""
    number = told(database)
    answer = checked(client, number, "lift_speed", "confirmed", note="filmed: <twice> as fast")
    assert answer.status_code == 200, answer.text
    assert answer.json() == client.get(f"/v1/diagnoses/{number}").json()
    assert checked(client, number, "density", "confirmed").status_code == 200
    found = claims_of(client, number)
    assert (found["lift_speed"]["state"], found["lift_speed"]["level"]) == ("confirmed", "strong claim")
    (check,) = found["lift_speed"]["checks"]
    assert (check["state"], check["note"]) == ("confirmed", "filmed: <twice> as fast")
    assert check["at"].startswith("20")
    assert levels(client, number) == {"lift_speed": "strong claim", "density": "named"}
    with database.reading() as session:
        assert session.get_one(DiagnosisRow, number).results == {**RESULT, "claims": [LIFT, NAMED]}
    for path in (f"/diagnoses/{number}", f"/diagnoses/{number}/report"):
        page = client.get(path).text
        assert (
            "strong claim" in page and "filmed: &lt;twice&gt; as fast" in page and "<b>Confirmed</b>" in page
        )


def test_a_withdrawn_claim_stays_visible_with_all_that_was_said(
    client: TestClient, database: Database
) -> None:
    number = told(database)
    assert "Withdraw</button>" in client.get(f"/diagnoses/{number}").text
    checked(client, number, "lift_speed", "confirmed", note="seemed so")
    checked(client, number, "lift_speed", "withdrawn", note="the film was of another day")
    claim = claims_of(client, number)["lift_speed"]
    assert (claim["state"], claim["level"]) == ("withdrawn", "claim")
    assert [(c["state"], c["note"]) for c in claim["checks"]] == [
        ("confirmed", "seemed so"),
        ("withdrawn", "the film was of another day"),
    ]
    again = checked(client, number, "lift_speed", "confirmed")
    assert again.status_code == 409
    assert again.headers["content-type"] == "application/problem+json"
    assert "The claim of lift_speed was withdrawn on 20" in again.json()["detail"]
    page = client.get(f"/diagnoses/{number}").text
    assert "<b>Withdrawn</b>" in page and "seemed so" in page and "another day" in page
    assert f"/v1/diagnoses/{number}/claims/lift_speed" not in page  # nothing is left to press
    assert f"/v1/diagnoses/{number}/claims/density" in page
    assert "lift_speed (withdrawn)" in client.get("/diagnoses").text


def test_the_same_check_twice_is_as_once(client: TestClient, database: Database) -> None:
    number = told(database)
    first, again = (checked(client, number, "lift_speed", "confirmed", note="seen") for _ in range(2))
    assert first.json() == again.json()
    checked(client, number, "lift_speed", "confirmed", note="seen on another day")
    assert len(claims_of(client, number)["lift_speed"]["checks"]) == 2
    with database.reading() as session:
        assert len(session.scalars(select(ClaimCheckRow)).all()) == 2


def test_models_that_rest_on_a_withdrawn_claim_are_withdrawn(client: TestClient, database: Database) -> None:
    """The version that the diagnosis made and what extends it; not the version that was diagnosed."""
    before, number = told(database), told(database)
    with database.writing() as session:
        rows: list[ModelVersionRow] = []
        for name, diagnosis in (("a", before), ("a+b", number), ("a+b+c", before), ("a+d", before)):
            parent = next((row.id for row in reversed(rows) if name.startswith(row.name)), None)
            rows.append(
                ModelVersionRow(name=name, diagnosis_id=diagnosis, base="x", effects={}, parent_id=parent)
            )
            session.add(rows[-1])
            session.flush()
    checked(client, number, "lift_speed", "confirmed")
    assert all(row["withdrawn_at"] is None for row in client.get("/v1/model-versions").json()["items"])
    checked(client, number, "lift_speed", "withdrawn")
    items = client.get("/v1/model-versions").json()["items"]
    withdrawn = {row["name"]: row["withdrawn_at"] is not None for row in items}
    assert withdrawn == {"a": False, "a+b": True, "a+b+c": True, "a+d": False}


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({"state": "proved"}, "state"),
        ({"state": "proposed"}, "state"),
        ({}, "state"),
        ({"state": "confirmed", "note": "x" * (LONGEST_NOTE + 1)}, "note"),
        ({"state": "confirmed", "note": "a\x00b"}, "note"),
        ({"state": "confirmed", "colour": "red"}, "colour"),
    ],
)
def test_a_wrong_check_names_its_field(
    client: TestClient, database: Database, body: dict[str, Any], field: str
) -> None:
    number = told(database)
    answer = client.post(f"/v1/diagnoses/{number}/claims/lift_speed", json=body)
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == field
    assert claims_of(client, number)["lift_speed"]["checks"] == []


def test_what_was_never_claimed_cannot_be_checked(client: TestClient, database: Database) -> None:
    number = told(database)
    waiting = a_diagnosis(database, a_data_set(database))
    missing = checked(client, number, "cohesion", "confirmed")
    assert missing.status_code == 404 and "it claims lift_speed, density" in missing.json()["detail"]
    assert checked(client, 99, "cohesion", "confirmed").status_code == 404
    early = checked(client, waiting, "cohesion", "confirmed")
    assert early.status_code == 409 and "it is waiting" in early.json()["detail"]
    client.post(f"/v1/diagnoses/{waiting}/cancel")
    nothing = checked(client, waiting, "cohesion", "confirmed")
    assert nothing.status_code == 404 and "it claims nothing" in nothing.json()["detail"]


def test_on_postgresql_too(postgres_database: Database) -> None:
    number = told(postgres_database)
    for outcome in (CheckOutcome.CONFIRMED, CheckOutcome.CONFIRMED, CheckOutcome.WITHDRAWN):
        with postgres_database.writing() as session:
            assert check_claim(session, number, "lift_speed", ClaimCheck(outcome)) is not None
    with postgres_database.reading() as session:
        rows = session.scalars(select(ClaimCheckRow).order_by(ClaimCheckRow.id)).all()
        assert [row.outcome.value for row in rows] == ["confirmed", "withdrawn"]


def test_the_levels_are_the_analysers() -> None:
    assert LEVELS[1:] == (CLAIM, STRONG_CLAIM)
    confirmed = (ClaimCheck(CheckOutcome.CONFIRMED),)
    assert [JudgedClaim("x", level, confirmed).level for level in LEVELS] == [LEVELS[0], LEVELS[2], LEVELS[2]]

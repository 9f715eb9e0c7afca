"""The pages of diagnoses: the list, one that waits, one with a verdict; words for what rows hold."""

from __future__ import annotations

import json
from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.dashboard.words import DIAGNOSIS_STATES, DIAGNOSIS_TONES, DIAGNOSIS_VERDICTS
from service.db.models import ArtifactRow, DiagnosisRow
from service.db.session import Database
from service.domain.diagnosis import PLAN, PlanSpec
from service.domain.states import DesignState
from tests.builders.diagnoses import a_data_set, a_diagnosis
from worker.diagnosis import result as results

RESULT: dict[str, Any] = {
    "verdict": "named",
    "claims": [
        {
            "effect": "lift_speed",
            "class": "lift_speed",
            "inclusion": 0.991,
            "amplitude": {"value": 0.62, "unit": "1", "ci90": [0.5, 0.74]},
            "level": "claim",
        }
    ],
    "also_possible": [{"effect": "cohesion", "inclusion": 0.03}],
    "not_testable": ["belt_speed"],
    "indistinguishable": [["density", "weigh_gain"]],
    "unexplained": [],
    "remainder": {"p_value": 0.4, "where": []},
    "gain": {"log_score": 12.3, "null_95": 1.1, "rmse_before": 2.4, "rmse_after": 1.1},
    "next_measurement": [{"what": "film the lift", "cost": 0.5}],
    "cost": {"runs": 1234, "simulated": 1000},
    "model_version": "demcore-paper-600",
    "limits": [{"effect": "lift_speed", "detectable_from": 0.21, "unit": "1"}],
    "p_value": 0.008,
    "sentences": ["The floor is <assumed>."],
    "extended_model": "baseline+lift_speed",
    "baseline": {
        "parameters": {
            "pellet": {"rolling_resistance": {"value": 0.312, "ci90": [0.25, 0.37], "averaged": 0.33}},
        },
        "box": {"rolling_resistance": [0.0, 0.5]},
        "rows": ["pellet rolling_resistance"],
        "covariance": [[0.005]],
    },
}

OUTLOOK: dict[str, Any] = {
    "verdict": "plan",
    "effects": [
        {
            "effect": "lift_speed",
            "verdict": "detectable",
            "unit": "1",
            "detectable_from": 0.21,
            "nameable_from": None,
            "alike": ["density"],
        }
    ],
    "adds": [{"condition": "held", "nameable": ["cohesion"]}],
    "sentences": ["One cause could be named."],
    "cost": {"runs": 10, "simulated": 10},
    "model_version": "demcore-paper-600",
}


@pytest.fixture
def database(sqlite_database: Database) -> Database:
    """The client's."""
    return sqlite_database


@pytest.fixture
def asked(database: Database) -> int:
    """A diagnosis that waits."""
    return a_diagnosis(database, a_data_set(database))


@pytest.fixture
def told(database: Database, asked: int) -> int:
    """The same with a verdict and a card."""
    with database.writing() as session:
        row = session.get_one(DiagnosisRow, asked)
        row.state, row.verdict, row.results = DesignState.COMPLETE, "named", RESULT
        session.add(
            ArtifactRow(
                diagnosis_id=asked,
                kind="card",
                media_type="image/png",
                sha256="0" * 64,
                size_bytes=1,
                file_name="card.png",
                path="x",
            )
        )
    return asked


def test_without_one_the_list_says_how_to_begin(client: TestClient) -> None:
    text = client.get("/diagnoses").text
    assert "No diagnosis yet" in text and "talus diagnose FOLDER" in text


def test_one_that_waits_says_what_it_will_cost(client: TestClient, asked: int) -> None:
    text = client.get(f"/diagnoses/{asked}").text
    assert "Waits for a free worker." in text and "There is no verdict yet." in text
    assert "They are told at the end." in text
    assert "pile tests" in text  # the estimate
    assert "data-over" not in text
    parts = client.get(f"/diagnoses/{asked}/parts").json()
    assert parts["is_over"] is False and "waiting" in parts["html"]["diagnosis_state"]
    assert f'href="/diagnoses/{asked}"' in client.get("/diagnoses").text


def test_a_verdict_is_told_in_words_with_card_limits_and_files(client: TestClient, told: int) -> None:
    text = client.get(f"/diagnoses/{told}").text
    assert "the cylinder was lifted at another speed than stated" in text
    assert "1.9 (1.6 to 2.1) times the stated lift speed" in text and "inclusion 0.991" in text
    assert "0.81 or 1.2 times the stated lift speed" in text  # from which size on it shows
    assert "to confirm, film the lift" in text
    assert "gains" in text and "12.3 nats" in text
    assert "baseline+lift_speed" in text and "Silent in these data: belt_speed." in text
    assert '<img src="/v1/artifacts/1"' in text and "data-over" in text
    assert "The floor is &lt;assumed&gt;." in text
    assert "Calibrated parameters" in text and "rolling resistance" in text
    assert "0.312" in text and "0.25 and 0.37" in text
    assert "0.312" in client.get(f"/diagnoses/{told}/report").text
    listed = client.get("/diagnoses").text
    assert "lift_speed" in listed and "1234" in listed


def test_a_plan_tells_what_its_tests_could_show(client: TestClient, database: Database) -> None:
    asked = a_diagnosis(database, a_data_set(database), plan=PlanSpec(candidates=("held",)))
    waiting = client.get(f"/diagnoses/{asked}").text
    assert "3 planned with 4 replicates, 1 candidates" in waiting and "There is no answer yet." in waiting
    with database.writing() as session:
        row = session.get_one(DiagnosisRow, asked)
        row.state, row.verdict, row.results = DesignState.COMPLETE, PLAN, OUTLOOK
    text = client.get(f"/diagnoses/{asked}").text
    assert "what planned tests could show" in text and "The card" not in text
    assert "<b>held</b> adds: cohesion." in text and "One cause could be named." in text
    assert "the cylinder was lifted at another speed than stated" in text
    assert "0.81 or 1.2 times the stated lift speed" in text and "–" in text and "density" in text


def test_no_verdict_says_more_than_its_test(client: TestClient, database: Database, told: int) -> None:
    likely = [{"effect": "cohesion", "inclusion": 0.93}]

    def page_of(verdict: str, **changes: Any) -> str:
        with database.writing() as session:
            row = session.get_one(DiagnosisRow, told)
            row.verdict, row.results = verdict, {**RESULT, "claims": [], "verdict": verdict, **changes}
        return client.get(f"/diagnoses/{told}").text

    assert "nothing larger than the limits of these data was detected" in page_of("no_misfit")
    one = page_of("ambiguous", also_possible=likely)
    assert "one cause is the likeliest, but it is not named" in one and "which of several causes" not in one
    assert "The likeliest, but not named, with how probable it is" in one
    assert "one cause is the likeliest" in client.get("/diagnoses").text
    two = page_of("ambiguous", also_possible=[*likely, {"effect": "density", "inclusion": 0.5}])
    assert "which of several causes" in two and "one cause is the likeliest" not in two


def test_the_policy_and_pages_that_are_not_there(client: TestClient, told: int) -> None:
    answer = client.get(f"/diagnoses/{told}")
    assert "script-src 'self'" in answer.headers["content-security-policy"]
    assert " style=" not in answer.text
    for path in ("/diagnoses/99", "/diagnoses/x", "/diagnoses/99/parts"):
        assert client.get(path).status_code == 404
    assert client.get("/diagnoses?before=1").text.count("There are no older diagnoses") == 1
    assert json.loads(client.get("/diagnoses/parts").text)["is_over"] is False


def test_every_verdict_and_state_has_its_word() -> None:
    said = {results.NO_MISFIT, results.NAMED, results.NAMED_WITH_REMAINDER, results.AMBIGUOUS}
    assert (
        {*said, results.UNEXPLAINED, results.REFUSED, PLAN} == set(DIAGNOSIS_VERDICTS) == set(DIAGNOSIS_TONES)
    )
    assert {state.value for state in DesignState} == set(DIAGNOSIS_STATES)

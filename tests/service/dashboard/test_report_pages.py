"""Reports to keep: one page with everything inside, nothing fetched; and the request that repeats it."""

from __future__ import annotations

import json
import re
from html import unescape
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select

from service.api.study_body import StudyBody
from service.client.commands import REPORTS
from service.client.rest import Client, RefusedError
from service.dashboard.angle_plot import HEIGHT, WIDTH, draw_angles
from service.dashboard.report_page import policy, style
from service.db.models import DesignRow, DiagnosisRow, ReportRow
from service.db.session import Database
from service.domain.spec_record import request_of, spec_from_record
from service.domain.states import DesignState, Verdict
from tests.builders import piles
from tests.builders.diagnoses import a_data_set, a_diagnosis
from tests.service.dashboard.test_diagnosis_pages import OUTLOOK, RESULT

STUDIES = Path(__file__).resolve().parents[3] / "docs/studies"


def imported(client: TestClient, name: str) -> int:
    content = (STUDIES / name / "study.json").read_bytes()
    headers = {"Content-Type": "application/json"}
    answer = client.post("/v1/studies/import", content=content, headers=headers)
    assert answer.status_code == 201, answer.text
    number: int = answer.json()["id"]
    return number


def stands_alone(text: str) -> bool:
    """Nothing that a browser would fetch or run: links lead away, but are only followed by a person."""
    fetched = re.findall(r"<(?:script|link|iframe|object)\b", text)
    sources = re.findall(r'\bsrc="([^"]*)"', text) + re.findall(r"url\(([^)]*)\)", text)
    return not fetched and all(source.startswith("data:") for source in sources) and " style=" not in text


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("sinter", ["31.19°", "Certified", "not identified", "35</td>", "Test next: Tilt"]),
        ("coke", ["33.3", "Expected distance from the target"]),
        ("pellet_coarse", ["25.46°", "(coarse)"]),
    ],
)
def test_a_study_is_one_page(client: TestClient, name: str, expected: list[str]) -> None:
    answer = client.get(f"/studies/{imported(client, name)}/report")
    assert answer.status_code == 200
    assert stands_alone(answer.text)
    assert f"<style>{style()}</style>" in answer.text
    assert answer.headers["content-security-policy"] == policy()
    assert "script-src 'self'" in policy() and "'unsafe-inline'" not in policy()
    assert len(answer.content) < 1_000_000
    for text in expected:
        assert text in unescape(answer.text), text


@pytest.mark.parametrize("name", ["sinter", "coke_half_warm", "pellet_coarse", "pellet"])
def test_its_request_asks_for_the_same_study(client: TestClient, name: str) -> None:
    """What the page prints becomes the stored study again, through the API's own reading."""
    text = client.get(f"/studies/{imported(client, name)}/report").text
    printed = json.loads(unescape(re.findall(r"<pre>(.*?)</pre>", text, re.DOTALL)[0]))
    record = json.loads((STUDIES / name / "study.json").read_text())["study"]["spec"]
    assert printed == request_of(record)
    assert StudyBody(**printed).to_spec() == spec_from_record(record)


def test_a_study_without_a_result_says_so(client: TestClient) -> None:
    number = client.post("/v1/studies", json={"material": "pellet", "budget": 3}).json()["id"]
    text = client.get(f"/studies/{number}/report").text
    assert "No simulation has given an angle." in text
    assert "so nothing was checked" in text
    assert stands_alone(text)


@pytest.mark.parametrize(
    ("result", "plan", "expected"),
    [
        (RESULT, False, ["What the simulation gets wrong", "12.3 nats", "The floor is &lt;assumed&gt;."]),
        (OUTLOOK, True, ["What planned tests could show", "<b>held</b> adds: cohesion."]),
    ],
)
def test_a_diagnosis_is_one_page(
    client: TestClient, sqlite_database: Database, result: dict[str, Any], plan: bool, expected: list[str]
) -> None:
    asked = {"plan": {"candidates": ["held"]}} if plan else {}
    data = a_data_set(sqlite_database)
    number = client.post("/v1/diagnoses", json={"data_set": data, **asked}).json()["id"]
    with sqlite_database.writing() as session:
        row = session.get_one(DiagnosisRow, number)
        row.state, row.verdict, row.results = DesignState.COMPLETE, result["verdict"], result
    answer = client.get(f"/diagnoses/{number}/report")
    assert answer.status_code == 200
    assert stands_alone(answer.text)
    for text in expected:
        assert text in answer.text, text
    assert answer.headers["content-disposition"] == f'inline; filename="diagnosis-{number}.html"'


@pytest.mark.parametrize("address", ["/studies/9/report", "/studies/x/report", "/diagnoses/9/report"])
def test_what_is_not_there_is_a_page_that_says_so(client: TestClient, address: str) -> None:
    assert client.get(address).status_code == 404


def test_the_command_line_fetches_them(client: TestClient, sqlite_database: Database) -> None:
    number = imported(client, "sinter")
    diagnosis = a_diagnosis(sqlite_database, a_data_set(sqlite_database))
    with Client("http://testserver", transport=client._transport) as rest:
        assert REPORTS["study"](rest, number).startswith(b"<!doctype html>")
        assert b"There is no verdict yet." in REPORTS["diagnosis"](rest, diagnosis)
        with pytest.raises(RefusedError, match="There is no study 99"):
            REPORTS["study"](rest, 99)


def test_points_of_the_drawing_are_where_their_numbers_are() -> None:
    """Two angles about a target in the middle are drawn as far above it as below, the first to the left."""
    rows = [
        DesignRow(number=k, angle_deg=angle, angle_sd_deg=1.0, verdict=Verdict.FEASIBLE)
        for k, angle in ((1, 20.0), (2, 30.0))
    ]
    plot = draw_angles([*rows, DesignRow(number=3)], (24.0, 26.0), 25.0, {2})
    assert plot is not None
    first, second = plot.points
    assert first.x < second.x
    assert second.y - plot.target == pytest.approx(plot.target - first.y)
    assert plot.window[0] - plot.window[1] == pytest.approx((first.y - second.y) / 5.0, abs=0.02)
    assert (first.is_chosen, second.is_chosen) == (False, True)
    assert all(0.0 <= p.x <= WIDTH and 0.0 <= p.y <= HEIGHT for p in plot.points)
    assert [text for _, text in plot.y_ticks] == ["20", "22", "24", "26", "28", "30"]
    assert draw_angles([], (24.0, 26.0), 25.0, ()) is None


def test_a_report_that_knows_less_than_the_study_is_drawn_all_the_same(
    client: TestClient, sqlite_database: Database
) -> None:
    """An imported study's report is whatever its file held."""
    study_id = piles.a_finished_study(sqlite_database, certified=True)
    with sqlite_database.writing() as session:
        row = session.scalars(select(ReportRow)).one()
        known = row.content["posterior"]
        row.content = {**row.content, "posterior": {**known, "parameters": known["parameters"][:1]}}
    text = client.get(f"/studies/{study_id}/report").text
    assert "<td>identified</td>" in text and text.count("<td>–</td>") >= 2

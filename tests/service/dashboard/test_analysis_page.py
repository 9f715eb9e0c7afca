"""A study's analysis as it is sent: light, in few statements, whole without its report, safe with any."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import event

from service.db.models import ReportRow
from service.db.session import Database
from service.settings import Settings
from service.studies.request_report import request_report
from tests.builders import piles
from tests.builders.analyses import EVERY_FAILS, a_scattered_study
from tests.builders.studies import a_study, write_report

MOST_BYTES = 250_000
MOST_STATEMENTS = 10


def data_of(text: str) -> Any:
    found = re.search(r'<script type="application/json" id="analysis">(.*?)</script>', text, re.S)
    assert found is not None
    return json.loads(found[1])


@contextmanager
def counted(client: TestClient) -> Iterator[list[str]]:
    """The statements that the application's database runs meanwhile."""
    engine = client.app.state.database.engine  # type: ignore[attr-defined]
    seen: list[str] = []

    def count(_c: Any, _u: Any, statement: str, *_rest: Any) -> None:
        seen.append(statement)

    event.listen(engine, "before_cursor_execute", count)
    try:
        yield seen
    finally:
        event.remove(engine, "before_cursor_execute", count)


def test_five_hundred_designs_are_a_light_page_in_few_statements(
    client: TestClient, sqlite_database: Database
) -> None:
    sizes = {}
    for designs in (14, 500):
        study_id = a_scattered_study(sqlite_database, designs)
        with counted(client) as statements:
            response = client.get(f"/studies/{study_id}/analysis")
        assert response.status_code == 200
        sizes[designs] = (len(response.content), len(statements))
    assert sizes[500][0] < MOST_BYTES
    assert sizes[500][1] == sizes[14][1] <= MOST_STATEMENTS


def test_columns_have_units_ranges_and_windows(client: TestClient, sqlite_database: Database) -> None:
    data = data_of(client.get(f"/studies/{a_scattered_study(sqlite_database, 26)}/analysis").text)
    columns = {column["name"]: column for column in data["columns"]}
    assert columns["rolling_resistance"]["range"] == [0.05, 0.6]
    assert columns["angle_deg"] | {"text": "", "meaning": ""} == {
        "name": "angle_deg",
        "text": "",
        "meaning": "",
        "unit": "°",
        "kind": "response",
        "target": 25.5,
        "window": [25.0, 26.0],
    }
    assert (columns["mass_on_base_kg"]["unit"], columns["mass_on_base_kg"]["kind"]) == ("kg", "other")
    designs = data["designs"]
    failed = [
        n for n, angle in zip(designs["number"], designs["values"]["angle_deg"], strict=True) if angle is None
    ]
    assert failed == [EVERY_FAILS, 2 * EVERY_FAILS]
    assert len(data["report"]["pairs"]) == 6 and data["report"]["draws"]["x"]


def test_parts_hold_the_data_only_when_something_happened(
    client: TestClient, sqlite_database: Database
) -> None:
    study_id = piles.a_searching_study(sqlite_database)
    at = f"/studies/{study_id}/analysis/parts"
    whole = client.get(at).json()
    assert len(whole["charts"]["analysis"]["designs"]["number"]) == 4 and not whole["is_over"]
    assert client.get(f"{at}?after={whole['cursor']}").json()["charts"] == {}
    piles.finish_running(sqlite_database, study_id, 25.2)
    later = client.get(f"{at}?after={whole['cursor']}").json()
    assert len(later["charts"]["analysis"]["designs"]["number"]) == 5


@pytest.mark.parametrize(
    "content", [{"enough": True}, {"enough": False, "text": "At least three designs."}, {}]
)
def test_a_report_that_lacks_things_is_no_broken_page(
    content: dict[str, Any], client: TestClient, sqlite_database: Database
) -> None:
    study_id = a_scattered_study(sqlite_database, 14, with_report=False)
    with sqlite_database.writing() as session:
        session.add(ReportRow(study_id=study_id, designs=3, code_version=None, content=content))
    response = client.get(f"/studies/{study_id}/analysis/parts")
    assert response.status_code == 200


def test_the_page_tells_that_its_report_is_behind_or_being_written(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    study_id = piles.a_finished_study(sqlite_database, certified=True, settings=settings)
    text = client.get(f"/studies/{study_id}/analysis").text
    assert "not identified" in text and "Designs have ended since" not in text
    with sqlite_database.writing() as session:
        request_report(session, study_id)
    assert "disabled" in client.get(f"/studies/{study_id}/analysis").text
    write_report(sqlite_database, study_id)


def test_an_unknown_study_has_no_analysis(client: TestClient, sqlite_database: Database) -> None:
    a_study(sqlite_database)
    for address in ("/studies/9/analysis", "/studies/x/analysis", "/studies/9/analysis/parts"):
        assert client.get(address).status_code == 404

"""A study as a file: written, read in elsewhere, refused where it contradicts itself."""

from __future__ import annotations

import copy
import csv
import io
import json
from collections.abc import Callable
from typing import Any

import pytest
from arro3.io import read_parquet
from fastapi.testclient import TestClient
from sqlalchemy import event, func, select

from service.db.models import EventRow, StudyRow
from service.db.session import Database
from service.domain.states import StudyState
from service.studies.design_table import Column, escape_formula, to_csv
from service.studies.export_study import export_study
from service.studies.import_study import import_study
from service.studies.study_file import StudyFile, content_hash
from tests.builders.studies import (
    a_finished_study,
    a_study,
    add_finished_designs,
    designs,
    propose_next,
    study,
)

PP = "particle_particle_static_friction"


def exported(database: Database, study_id: int) -> dict[str, Any]:
    with database.reading() as session:
        file = export_study(session, study_id, "0.1.0")
    assert file is not None
    return file


def read_in(database: Database, file: dict[str, Any]) -> tuple[int, bool]:
    with database.writing() as session:
        row, is_new = import_study(session, StudyFile.model_validate(file))
        return row.id, is_new


def signed(file: dict[str, Any]) -> dict[str, Any]:
    """With the hash of what it holds now."""
    return {**file, "content_sha256": content_hash(file["study"])}


def test_a_study_comes_back_as_it_was(database: Database) -> None:
    """The content's hash, over everything but its place and hour, is the same after a journey."""
    source = a_finished_study(database)
    file = exported(database, source)
    through_text = json.loads(json.dumps(file))
    copy_id, is_new = read_in(database, through_text)
    assert is_new
    assert copy_id != source
    again = exported(database, copy_id)
    assert again["study"] == file["study"]
    assert again["content_sha256"] == file["content_sha256"]


def test_what_a_file_holds(sqlite_database: Database) -> None:
    file = exported(sqlite_database, a_finished_study(sqlite_database))
    content = file["study"]
    assert (file["format"], file["version"]) == ("talus-study", 1)
    assert content["stop"] == {
        "reason": "certified",
        "text": "Within 0.5 deg (90 %).",
        "numbers": {"sd_deg": 0.2},
    }
    assert content["recommendation"]["mean_deg"] == 25.4
    told = [
        (d["number"], d["state"], d["verdict"], d["angle_deg"], d["failure_class"])
        for d in content["designs"]
    ]
    assert told == [
        (1, "COMPLETE", "feasible", 25.4, None),
        (2, "COMPLETE", "unfeasible", 30.0, None),
        (3, "FAILED", "error", None, "no_result"),
        (4, "CANCELLED", None, None, None),
    ]
    third = content["designs"][2]
    assert third["prediction"] == {"mean_deg": 25.5, "sd_deg": 0.4}
    assert third["hyperparameters"]["noise_sd_deg"] == 0.5
    assert third["reason"] == "spread over the box"
    (run,) = third["runs"]
    assert (run["exit_class"], run["wall_s"], run["code_version"]) == ("no_result", 12.5, "0123456789abcdef")


def test_the_same_file_is_one_study(database: Database) -> None:
    file = exported(database, a_finished_study(database))
    first, _ = read_in(database, file)
    later = {**file, "exported_at": file["exported_at"] + 1e6, "talus_version": "9.9"}
    assert read_in(database, later) == (first, False)


def test_an_imported_study_is_over_and_nobody_works_on_it(database: Database) -> None:
    copy_id, _ = read_in(database, exported(database, a_finished_study(database)))
    row = study(database, copy_id)
    assert (row.state, row.feasible, row.unfeasible, row.error) == (StudyState.COMPLETED, 1, 1, 1)
    with database.reading() as session:
        kinds = session.scalars(select(EventRow.kind).where(EventRow.study_id == copy_id)).all()
    assert kinds == ["study_imported"]


def test_a_study_that_still_ran_comes_as_a_stopped_one(database: Database) -> None:
    study_id = a_study(database, parallel=2)
    propose_next(database, study_id)
    copy_id, _ = read_in(database, exported(database, study_id))
    row = study(database, copy_id)
    assert (row.state, row.stop_reason) == (StudyState.CANCELLED, "exported_early")
    assert row.ended_at is not None
    assert [d.state.value for d in designs(database, copy_id)] == ["CANCELLED"]


def test_export_and_import_take_few_statements(sqlite_database: Database) -> None:
    study_id = a_study(sqlite_database, budget=200)
    add_finished_designs(sqlite_database, study_id, 200)
    statements = list[str]()
    event.listen(sqlite_database.engine, "before_cursor_execute", lambda *args: statements.append(args[2]))
    file = exported(sqlite_database, study_id)
    assert len([text for text in statements if text.startswith("SELECT")]) <= 8
    statements.clear()
    read_in(sqlite_database, file)
    assert len(statements) < 220, "one a design and a few"


def at(path: str, value: Any) -> Callable[[dict[str, Any]], None]:
    """Sets one field, deep in the study."""

    def change(content: dict[str, Any]) -> None:
        *parents, last = [int(part) if part.isdigit() else part for part in path.split(".")]
        place: Any = content
        for part in parents:
            place = place[part]
        if value is ...:
            del place[last]
        else:
            place[last] = value

    return change


# change of the study, field that is named, part of what is allowed
CONTRADICTIONS = {
    "unknown field": (at("colour", "red"), "study.colour", "no such field"),
    "no designs": (at("designs", ...), "study.designs", "required"),
    "a gap": (at("designs.1.number", 7), "study.designs.1.number", "2: numbers have no gaps"),
    "twice": (at("designs.1", ...), "study.designs.1.number", "2"),
    "variable missing": (at(f"designs.0.x.{PP}", ...), "study.designs.0.x", PP),
    "x as text": (at(f"designs.0.x.{PP}", "0.5"), f"study.designs.0.x.{PP}", "a number"),
    "unknown state": (at("designs.0.state", "ASLEEP"), "study.designs.0.state", "COMPLETE"),
    "no verdict": (at("designs.0.verdict", None), "study.designs.0.verdict", "a verdict"),
    "verdict without end": (at("designs.3.verdict", "feasible"), "study.designs.3.verdict", "none for"),
    "failed and feasible": (at("designs.2.verdict", "feasible"), "study.designs.2.verdict", "error"),
    "nothing measured": (at("designs.0.responses", None), "study.designs.0.responses", "observable"),
    "attempts alike": (
        lambda content: content["designs"][0]["runs"].append(content["designs"][0]["runs"][0]),
        "study.designs.0.runs",
        "each attempt once",
    ),
    "huge number": (at("designs.0.seed", 2**40), "study.designs.0.seed", "2147483647"),
    "NUL": (at("designs.0.reason", "a\x00b"), "study.designs.0.reason", "NUL"),
    "half a pair": (at("designs.0.results.note", "\ud800"), "study.designs.0.results", "surrogates"),
    "long word": (at("stop.reason", "x" * 40), "study.stop.reason", "at most 32"),
    "spec without space": (at("spec.variables", ...), "study.spec", "talus export"),
    "spec as list": (at("spec", []), "study.spec", "an object"),
    "spec budget 0": (at("spec.budget", 0), "study.spec.budget", "1 to 1000"),
    "infinite": (at("designs.0.angle_deg", float("inf")), "study.designs.0.angle_deg", "a finite number"),
    "infinite inside": (at("designs.0.results.a", float("nan")), "study.designs.0.results", "finite numbers"),
    "endless": (
        at("designs.0.results.a", json.loads("[" * 40 + "]" * 40)),
        "study.designs.0.results",
        "levels of nesting",
    ),
}


@pytest.fixture
def file(sqlite_database: Database) -> dict[str, Any]:
    return exported(sqlite_database, a_finished_study(sqlite_database))


def refused(client: TestClient, content: bytes) -> tuple[str, str]:
    headers = {"content-type": "application/json"}
    response = client.post("/v1/studies/import", content=content, headers=headers)
    assert response.status_code == 422, response.text
    assert response.headers["content-type"] == "application/problem+json"
    error = response.json()["errors"][0]
    assert error["field"] in response.json()["detail"]
    return error["field"], error["allowed"]


@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_a_file_that_contradicts_itself_is_refused(
    client: TestClient, sqlite_database: Database, file: dict[str, Any], name: str
) -> None:
    change, field, allowed = CONTRADICTIONS[name]
    content = copy.deepcopy(file)
    change(content["study"])
    try:
        content = signed(content)
    except ValueError:
        assert name.startswith("infinite")
    told_field, told_allowed = refused(client, json.dumps(content).encode())
    assert told_field == field
    assert allowed in told_allowed
    with sqlite_database.reading() as session:
        assert session.scalar(select(func.count()).select_from(StudyRow)) == 1


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"version": 2}, "version"),
        ({"version": 2, "study": {"new": "shape"}}, "version"),
        ({"format": "talus-charge"}, "format"),
        ({"content_sha256": "0" * 64}, "content_sha256"),
        ({"content_sha256": "abc"}, "content_sha256"),
        ({"study": 7}, "study"),
        ({"extra": 1}, "extra"),
    ],
)
def test_another_version_or_a_changed_file_is_refused(
    client: TestClient, file: dict[str, Any], change: dict[str, Any], field: str
) -> None:
    assert refused(client, json.dumps({**file, **change}).encode())[0] == field


def test_a_changed_number_is_noticed(client: TestClient, file: dict[str, Any]) -> None:
    file["study"]["designs"][0]["angle_deg"] = 25.5
    field, allowed = refused(client, json.dumps(file).encode())
    assert (field, "damaged" in allowed) == ("content_sha256", True)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.999])
def test_a_truncated_file_is_refused(client: TestClient, file: dict[str, Any], share: float) -> None:
    text = json.dumps(file).encode()
    assert refused(client, text[: int(share * len(text))])[0] == "body"


def test_a_huge_file_is_refused_before_it_is_parsed(client: TestClient) -> None:
    field, allowed = refused(client, b" " * 50_000_001)
    assert (field, allowed) == ("body", "at most 50000000 bytes")


def test_over_http_and_back(client: TestClient, file: dict[str, Any], sqlite_database: Database) -> None:
    answer = client.get("/v1/studies/1/export")
    assert answer.json()["study"] == file["study"]
    assert answer.headers["content-disposition"] == 'attachment; filename="study-1.json"'
    made = client.post(
        "/v1/studies/import", content=answer.content, headers={"content-type": "application/json"}
    )
    assert (made.status_code, made.json()["state"]) == (201, "completed")
    again = client.post("/v1/studies/import", json=answer.json())
    assert (again.status_code, again.json()["id"]) == (200, made.json()["id"])
    assert made.headers["location"] == f"/v1/studies/{made.json()['id']}"
    for path in ("export", "designs.csv", "designs.parquet"):
        assert client.get(f"/v1/studies/99/{path}").status_code == 404


def test_both_tables_hold_the_same(client: TestClient, file: dict[str, Any]) -> None:
    rows = list(csv.DictReader(io.StringIO(client.get("/v1/studies/1/designs.csv").text)))
    table = read_parquet(io.BytesIO(client.get("/v1/studies/1/designs.parquet").content)).read_all()
    assert list(rows[0]) == table.column_names
    assert [row["number"] for row in rows] == ["1", "2", "3", "4"]
    assert [row["verdict"] for row in rows] == ["feasible", "unfeasible", "error", ""]
    for name, values in zip(table.column_names, table.columns, strict=True):
        told = ["" if value is None else str(value) for value in values.to_pylist()]
        assert told == [row[name] for row in rows], name
    first = {
        name: column.to_pylist()[0] for name, column in zip(table.column_names, table.columns, strict=True)
    }
    assert first["angle_deg"] == 25.4
    assert first[PP] == 0.11
    assert first["wall_s"] == 12.5
    third = {
        name: column.to_pylist()[2] for name, column in zip(table.column_names, table.columns, strict=True)
    }
    assert (third["predicted_mean_deg"], third["failure_class"]) == (25.5, "no_result")


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1+cmd|' /C calc'!A0", "@SUM(A1)", "\t=1", "\r=1", "\n=1"])
def test_a_text_that_a_spreadsheet_would_run_is_escaped(text: str) -> None:
    written = to_csv([Column("reason", str, [text]), Column("angle_deg", float, [-1.5])]).decode()
    ((told, number),) = list(csv.reader(io.StringIO(written, newline="")))[1:]
    assert told == f"'{text}"
    assert number == "-1.5", "a number stays one"
    assert escape_formula("spread over the box") == "spread over the box"

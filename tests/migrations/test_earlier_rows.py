"""Rows as the code of each earlier schema wrote them, brought to the newest one and read by today's code."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import MetaData, func, select, text

from service.app import create_app
from service.db import migrate
from service.db.models import StudyRow
from service.db.session import Database
from service.settings import Settings
from service.studies.read_history import read_history

DATA = Path(__file__).resolve().parents[1] / "data"
REVISIONS = ("0002", "0003", "0004")
PAGES = ("/", "/studies/1", "/designs/1", "/v1/studies/1", "/v1/studies/1/report", "/v1/jobs")
PAGES_OF = {
    "charges": ("/charges/1", "/v1/charges/1"),
    "diagnoses": ("/diagnoses/1", "/v1/diagnoses/1", "/v1/measurements/1"),
}


def fill(url: str, rows: dict[str, list[dict[str, Any]]]) -> None:
    """A database of the old schema with its rows."""
    database = Database(url)
    with database.writing() as session:
        tables = MetaData()
        tables.reflect(session.connection())
        for table in tables.sorted_tables:
            for row in rows.get(table.name, ()):
                # What is None is left out: as a value it would be stored as JSON's null where NULL was.
                session.execute(table.insert().values({k: v for k, v in row.items() if v is not None}))
            is_numbered = isinstance((rows.get(table.name) or [{}])[0].get("id"), int)
            if "sqlite" not in url and is_numbered:
                session.execute(text(f"select setval(pg_get_serial_sequence('{table.name}', 'id'), 1000)"))
    database.dispose()


def columns_of(table: str) -> dict[str, list[str]]:
    lines = list(csv.DictReader(io.StringIO(table)))
    return {name: [line[name] for line in lines] for name in lines[0]}


@pytest.mark.parametrize("revision", REVISIONS)
def test_rows_of_an_earlier_schema_say_the_same_today(empty_url: str, tmp_path: Path, revision: str) -> None:
    stored = json.loads((DATA / f"database_{revision}.json").read_text())
    migrate.upgrade(empty_url, revision)
    fill(empty_url, stored["rows"])
    migrate.upgrade(empty_url)
    database = Database(empty_url)
    with database.reading() as session:
        counts = {
            name: session.scalar(select(func.count()).select_from(text(name))) for name in stored["rows"]
        }
        history = read_history(session, session.get_one(StudyRow, 1))
    database.dispose()
    assert counts == {name: len(rows) for name, rows in stored["rows"].items()}
    # The fourth was cancelled.
    assert [design.number for design in history.finished] == [1, 2, 3]
    with TestClient(create_app(Settings(data_dir=tmp_path, database_url=empty_url))) as client:
        then = columns_of(stored["said"]["csv"])
        now = columns_of(client.get("/v1/studies/1/designs.csv").text)
        assert {name: now[name] for name in then} == then
        assert client.get("/v1/studies/1/export").json()["content_sha256"] == stored["said"]["content_sha256"]
        more = (page for table in stored["rows"] for page in PAGES_OF.get(table, ()))
        for page in (*PAGES, *more):
            assert client.get(page).status_code == 200, page

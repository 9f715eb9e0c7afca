"""The databases that these tests run on."""

from __future__ import annotations

from pathlib import Path

import pytest
from sqlalchemy import text

from service.db.session import Database
from tests.builders.databases import (
    database,
    migrated_sqlite,
    postgres,
    postgres_database,
    sqlite_database,
)
from tests.builders.postgres import Postgres

__all__ = ["database", "empty_url", "migrated_sqlite", "postgres", "postgres_database", "sqlite_database"]


@pytest.fixture(params=["sqlite", "postgresql"])
def empty_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'empty.db'}"
    server = request.getfixturevalue("postgres")
    assert isinstance(server, Postgres)
    database = Database(server.url())
    with database.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
        connection.execute(text("drop database if exists empty with (force)"))
        connection.execute(text("create database empty"))
    database.dispose()
    return server.url("empty")

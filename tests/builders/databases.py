"""Fixtures: a migrated, empty database per test, on SQLite and on PostgreSQL."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from sqlalchemy import make_url, text

from service.db.migrate import upgrade
from service.db.models import Base
from service.db.session import Database
from tests.builders.postgres import Postgres, running_postgres


@pytest.fixture(scope="session")
def postgres() -> Iterator[Postgres]:
    """The server of this test session; started when first asked for."""
    with running_postgres() as server:
        upgrade(server.url())
        yield server


@pytest.fixture(scope="session")
def migrated_sqlite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An empty database at head, to be copied: migrating once is enough."""
    path = tmp_path_factory.mktemp("migrated") / "talus.db"
    upgrade(f"sqlite:///{path}")
    return path


@pytest.fixture
def sqlite_database(tmp_path: Path, migrated_sqlite: Path) -> Iterator[Database]:
    """An empty SQLite database of its own."""
    path = tmp_path / "talus.db"
    shutil.copy(migrated_sqlite, path)
    database = Database(f"sqlite:///{path}")
    yield database
    database.dispose()


@pytest.fixture
def postgres_database(postgres: Postgres) -> Iterator[Database]:
    """The PostgreSQL database, emptied."""
    database = Database(postgres.url())
    with database.writing() as session:
        tables = ", ".join(table.name for table in Base.metadata.sorted_tables)
        session.execute(text(f"truncate {tables} restart identity cascade"))
    yield database
    database.dispose()


@pytest.fixture(params=["sqlite", "postgresql"])
def database(request: pytest.FixtureRequest) -> Database:
    """Each test that asks for it runs on both databases."""
    name = "sqlite_database" if request.param == "sqlite" else "postgres_database"
    found = request.getfixturevalue(name)
    assert isinstance(found, Database)
    return found


@contextmanager
def another_writer(database: Database) -> Iterator[None]:
    """Somebody else holds an SQLite database's write lock."""
    other = sqlite3.connect(make_url(database.url).database or "", isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    try:
        yield
    finally:
        other.execute("ROLLBACK")
        other.close()

"""Every schema change runs both ways, and leads to exactly the tables that the code thinks it has."""

from __future__ import annotations

from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from sqlalchemy import inspect, text

from service.db import migrate
from service.db.models import Base
from service.db.session import Database
from tests.builders.postgres import Postgres


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


def test_from_empty_to_head_gives_the_models(empty_url: str) -> None:
    migrate.upgrade(empty_url)
    database = Database(empty_url)
    with database.reading() as session:
        assert migrate.current_revision(session) == migrate.newest_revision()
        context = MigrationContext.configure(session.connection(), opts={"compare_type": True})
        assert compare_metadata(context, Base.metadata) == []
    database.dispose()


def test_check_constraints_are_those_of_the_models(tmp_path: Path) -> None:
    """Alembic does not compare these; the texts are the same on both databases."""
    urls = [f"sqlite:///{tmp_path / name}.db" for name in ("migrated", "modelled")]
    migrate.upgrade(urls[0])
    databases = [Database(url) for url in urls]
    Base.metadata.create_all(databases[1].engine)
    migrated, modelled = (
        {
            (table.name, check["name"], check["sqltext"])
            for table in Base.metadata.sorted_tables
            for check in inspect(database.engine).get_check_constraints(table.name)
        }
        for database in databases
    )
    assert migrated == modelled
    assert ("jobs", "ck_jobs_design") in {check[:2] for check in migrated}
    for database in databases:
        database.dispose()


def test_down_to_base_leaves_nothing_and_up_again_works(empty_url: str) -> None:
    migrate.upgrade(empty_url)
    migrate.downgrade(empty_url, "base")
    database = Database(empty_url)
    assert set(inspect(database.engine).get_table_names()) <= {"alembic_version", "sqlite_sequence"}
    migrate.upgrade(empty_url)
    assert "studies" in inspect(database.engine).get_table_names()
    database.dispose()


def test_upgrading_twice_changes_nothing(empty_url: str) -> None:
    migrate.upgrade(empty_url)
    migrate.upgrade(empty_url)


def test_a_password_with_a_percent_sign_survives_the_configuration() -> None:
    url = "postgresql+psycopg://talus:50%25@localhost/talus"
    assert migrate.configuration(url).get_main_option("sqlalchemy.url") == url

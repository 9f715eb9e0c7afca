"""Every schema change runs both ways, and leads to exactly the tables that the code thinks it has."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from sqlalchemy import MetaData, inspect, select, text

from service.db import migrate, read_models
from service.db.models import ArtifactRow, Base, ChargeRow, DesignRow, JobRow, RunRow, StudyRow
from service.db.session import Database
from service.domain.states import JobKind, JobState, StudyState
from service.studies.read_history import read_history

OLD_DATABASE = Path(__file__).resolve().parents[1] / "data" / "database_0001.json"


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


def old_rows() -> dict[str, list[dict[str, Any]]]:
    """A completed and a finishing study as revision 0001's code left them."""
    rows: dict[str, list[dict[str, Any]]] = json.loads(OLD_DATABASE.read_text())
    return rows


def a_database_of_0001(url: str) -> Database:
    migrate.upgrade(url, "0001")
    database = Database(url)
    with database.writing() as session:
        tables = MetaData()
        tables.reflect(session.connection())
        for name in ("studies", "designs", "jobs", "runs", "events"):
            rows = old_rows()[name]
            table = tables.tables[name]
            for row in rows:
                # What is None is left out: as a value it would be stored as JSON's null where NULL was.
                values = {key: value for key, value in row.items() if value is not None}
                if "cancel_requested" in values:
                    values["cancel_requested"] = bool(values["cancel_requested"])
                session.execute(table.insert().values(values))
            if "sqlite" not in url and name != "jobs":
                session.execute(text(f"select setval(pg_get_serial_sequence('{name}', 'id'), 1000)"))
    return database


def test_a_database_of_0001_keeps_all_that_it_holds(empty_url: str) -> None:
    database = a_database_of_0001(empty_url)
    migrate.upgrade(empty_url)
    old = old_rows()
    with database.reading() as session:
        for name in ("studies", "designs", "jobs", "runs"):
            assert session.scalar(text(f"select count(*) from {name}")) == len(old[name])
        page = read_models.open_study(session, 1)
        history = read_history(session, session.get_one(StudyRow, 2))
    assert page is not None
    assert (page.study.state, page.study.failures_forgiven) == (StudyState.COMPLETED, 0)
    for view, row in zip(page.designs, old["designs"], strict=False):
        assert (view.design.number, view.design.x, view.design.angle_deg) == (
            row["number"],
            row["x"],
            row["angle_deg"],
        )
        assert view.proposal is not None
        assert view.proposal.training_hash == row["training_hash"]
        stored = view.surrogate.hyperparameters if view.surrogate else None
        assert stored == row["hyperparameters"]
        assert view.job is not None
        if row["angle_deg"] is not None:
            assert view.design.responses is not None
            assert view.design.responses["angle_deg"] == row["angle_deg"]
            assert view.design.responses["mass_on_base_kg"] == 12.5
            assert view.design.responses["heap_height_m"] == 0.12
            assert "discharge_t90_s" not in view.design.responses
    assert [design.number for design in history.finished] == list(range(1, 10))
    assert [design.number for design in history.finished if design.results is None] == [3]
    database.dispose()


def test_down_to_0001_and_up_again_gives_the_same(empty_url: str) -> None:
    database = a_database_of_0001(empty_url)
    migrate.upgrade(empty_url)
    with database.writing() as session:
        session.execute(text("update studies set state = 'paused', pause_reason = 'user' where id = 2"))
        # A repetition by hand of the error of design 3, which 0001's unique key would not take beside it.
        third = session.scalars(select(DesignRow).where(DesignRow.study_id == 1, DesignRow.number == 3)).one()
        names = ("study_id", "x", "x_hash", "scale", "seed", "origin", "reason")
        again = DesignRow(number=99, supersedes=3, **{name: getattr(third, name) for name in names})
        session.add(again)
        session.add(JobRow(id="r", kind=JobKind.REPORT, study_id=1, state=JobState.DONE, max_attempts=3))
        charge = ChargeRow(series=1, charge="coke", scale=8.0, seed=1, spec={}, cost={})
        session.add(charge)
        session.flush()
        session.add(JobRow(id="c", kind=JobKind.CHARGE, charge_id=charge.id, max_attempts=3))
        session.flush()
        session.add(RunRow(job_id="c", attempt=1, worker_id="w"))
        names = ("kind", "file_name", "media_type", "sha256", "path")
        session.add(ArtifactRow(charge_id=charge.id, size_bytes=1, **dict.fromkeys(names, "report")))
    migrate.downgrade(empty_url, "0001")
    with database.writing() as session:
        assert session.scalar(text("select state from studies where id = 2")) == "running"
        assert session.scalar(text("select count(*) from jobs where kind in ('report', 'charge')")) == 0
        assert session.scalar(text("select count(*) from runs where job_id = 'c'")) == 0
        assert session.scalar(text("select count(*) from artifacts")) == 0
        found = session.execute(
            text(
                "select number, state, training_hash, hyperparameters from designs where study_id = 1 order by id"
            )
        ).all()
        session.execute(text("delete from designs where number = 99"))
    old = [row for row in old_rows()["designs"] if row["study_id"] == 1]
    for row, expected in zip(found, old, strict=False):
        state = "CANCELLED" if row.number == 3 else expected["state"]
        assert (row.number, row.state, row.training_hash) == (
            expected["number"],
            state,
            expected["training_hash"],
        )
        kept = (
            json.loads(row.hyperparameters) if isinstance(row.hyperparameters, str) else row.hyperparameters
        )
        assert kept == expected["hyperparameters"]
    migrate.upgrade(empty_url)
    database.dispose()

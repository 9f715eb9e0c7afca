"""A backup made while work goes on, and what comes back from it, on either database."""

from __future__ import annotations

import tarfile
import threading
from pathlib import Path

import pytest
from sqlalchemy import func, select, text

from service.backup import MANIFEST, BackupError, make_backup, restore_backup
from service.db.migrate import upgrade
from service.db.models import ArtifactRow, Base, DesignRow, StudyRow
from service.db.session import Database
from service.domain.states import JobState
from service.file_store import artifact_store
from service.settings import Settings
from service.studies.keep_files import keep_files
from tests.builders.charges import charges
from tests.builders.diagnoses import a_data_set
from tests.builders.postgres import Postgres
from tests.builders.studies import a_finished_study, a_simulate_job, a_study, claimed, job
from worker.evaluate import store_file


@pytest.fixture
def settings(tmp_path: Path, database: Database) -> Settings:
    """The installation that is backed up."""
    return Settings(data_dir=tmp_path / "old", database_url=database.url.replace("+psycopg", ""))


@pytest.fixture(params=["sqlite", "postgresql"])
def empty(request: pytest.FixtureRequest, tmp_path: Path) -> Settings:
    """Where it is put back."""
    url = None
    if request.param == "postgresql":
        server = request.getfixturevalue("postgres")
        assert isinstance(server, Postgres)
        other = Database(server.url())
        with other.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
            connection.execute(text("drop database if exists restored with (force)"))
            connection.execute(text("create database restored"))
        other.dispose()
        url = server.url("restored").replace("+psycopg", "")
    return Settings(data_dir=tmp_path / "new", database_url=url)


def fill(database: Database, settings: Settings) -> Path:
    """Studies, a charge, a data set, and a design's file; the file."""
    study_id = a_finished_study(database)
    charges(database)
    a_data_set(database)
    store = artifact_store(settings)
    with store.incoming() as folder:
        incoming = folder / "pile.png"
        incoming.write_bytes(b"a picture")
        stored = store_file(incoming, "picture", "image/png", store)
    with database.writing() as session:
        design = session.scalars(select(DesignRow).where(DesignRow.study_id == study_id)).first()
        assert design is not None
        keep_files(session, [stored], design_id=design.id)
    return settings.artifacts_dir / stored.path


def content(database: Database) -> dict[str, list[tuple[object, ...]]]:
    """Every row of every table, but for who is there and which jobs have a message."""
    left_out = {"processes", "alembic_version"}
    with database.reading() as session:
        return {
            table.name: [
                tuple(value for name, value in row.items() if name not in ("published_at", "publications"))
                for row in session.execute(select(table).order_by(*table.primary_key)).mappings()
            ]
            for table in Base.metadata.sorted_tables
            if table.name not in left_out
        }


def test_everything_comes_back_on_either_database(
    database: Database, settings: Settings, empty: Settings, tmp_path: Path
) -> None:
    file = fill(database, settings)
    _, running = a_simulate_job(database)
    claimed(database, running)
    made = make_backup(settings, tmp_path / "backup.tar")
    found = restore_backup(empty, tmp_path / "backup.tar")
    assert (made.rows, made.files, made.missing) == (found.rows, 1, 0)
    restored = Database(empty.resolved_database_url)
    assert content(restored) == content(database)
    assert (empty.artifacts_dir / file.relative_to(settings.artifacts_dir)).read_bytes() == b"a picture"
    assert job(restored, running).state is JobState.RUNNING, "its lease ends, and another worker takes it"
    before = max(row[0] for row in content(database)["studies"])
    assert a_study(restored) > before, "ids go on where they were"
    with pytest.raises(BackupError, match="holds something already"):
        restore_backup(empty, tmp_path / "backup.tar")
    restored.dispose()


def test_a_backup_under_load_is_one_moment(database: Database, settings: Settings, tmp_path: Path) -> None:
    """Studies are made all the while, each with its job and event in one transaction: none is torn."""
    fill(database, settings)
    stop = threading.Event()
    started = threading.Event()

    def write() -> None:
        while not stop.is_set():
            a_study(database)
            started.set()

    writer = threading.Thread(target=write)
    writer.start()
    assert started.wait(30.0)
    try:
        make_backup(settings, tmp_path / "backup.tar")
    finally:
        stop.set()
        writer.join()
    empty = Settings(data_dir=tmp_path / "new")
    restore_backup(empty, tmp_path / "backup.tar")
    restored = Database(empty.resolved_database_url)
    with restored.reading() as session:
        studies = session.scalar(select(func.count()).select_from(StudyRow))
        told = session.scalar(text("select count(*) from events where kind = 'study_created'"))
        jobs = session.scalar(text("select count(distinct study_id) from jobs where study_id is not null"))
    assert studies == told == jobs
    restored.dispose()


def test_a_file_that_retention_took_is_told_of(
    database: Database, settings: Settings, tmp_path: Path
) -> None:
    fill(database, settings).unlink()
    assert make_backup(settings, tmp_path / "backup.tar").missing == 1


def test_nothing_half_is_left_and_nothing_is_written_over(
    sqlite_database: Database, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = Settings(data_dir=tmp_path / "old", database_url=sqlite_database.url)
    (tmp_path / "there.tar").write_bytes(b"mine")
    with pytest.raises(BackupError, match="is there already"):
        make_backup(settings, tmp_path / "there.tar")
    monkeypatch.setattr("service.backup._files", lambda *_: 1 / 0)
    before = sorted(tmp_path.iterdir())
    with pytest.raises(ZeroDivisionError):
        make_backup(settings, tmp_path / "new.tar")
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("harm", ["cut", "changed", "no tar", "no manifest", "outside"])
def test_a_damaged_backup_changes_nothing(
    harm: str, sqlite_database: Database, tmp_path: Path, migrated_sqlite: Path
) -> None:
    settings = Settings(data_dir=tmp_path / "old", database_url=sqlite_database.url)
    fill(sqlite_database, settings)
    source, bad = tmp_path / "backup.tar", tmp_path / "bad.tar"
    make_backup(settings, source)
    whole = source.read_bytes()
    if harm == "cut":
        bad.write_bytes(whole[: len(whole) // 2])
    elif harm == "changed":
        bad.write_bytes(whole.replace(b"a picture", b"b picture"))
    elif harm == "no tar":
        bad.write_bytes(b"\x00\x01" * 2000)
    else:
        with tarfile.open(source) as old, tarfile.open(bad, "w") as new:
            for member in old:
                if harm == "no manifest" and member.name == MANIFEST:
                    continue
                content_of = old.extractfile(member)
                if harm == "outside" and member.name.startswith("artifacts/"):
                    member.name = "../../outside"
                new.addfile(member, content_of)
    empty = Settings(data_dir=tmp_path / "new")
    with pytest.raises(BackupError):
        restore_backup(empty, bad)
    upgrade(empty.resolved_database_url)
    restored = Database(empty.resolved_database_url)
    with restored.reading() as session:
        assert session.scalar(select(func.count()).select_from(StudyRow)) == 0
        assert session.scalar(select(func.count()).select_from(ArtifactRow)) == 0
    restored.dispose()
    assert not list(tmp_path.rglob("outside"))

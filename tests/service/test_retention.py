"""Which files may go: old and large, of nobody, or of a job that is over; a dry run first."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest
from click.testing import CliRunner
from sqlalchemy import select, update

from service.client.maintenance import retention
from service.db.models import ArtifactRow, DesignRow, StudyRow
from service.db.session import Database
from service.domain.outcome import StoredArtifact
from service.retention import DAY_S, FRESH_S, Rule, find_removable, remove
from service.settings import Settings, get_settings
from service.studies.keep_files import keep_files
from tests.builders.studies import a_finished_study, a_simulate_job


@pytest.fixture
def settings(tmp_path: Path, sqlite_database: Database) -> Settings:
    return Settings(data_dir=tmp_path, database_url=sqlite_database.url)


def a_file(settings: Settings, name: str, age_s: float = 2 * FRESH_S) -> Path:
    path = settings.artifacts_dir / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"12345")
    when = time.time() - age_s
    os.utime(path, (when, when))
    return path


def name_it(database: Database, study_id: int, kind: str, path: str, number: int = 1) -> None:
    with database.writing() as session:
        design = session.scalars(
            select(DesignRow).where(DesignRow.study_id == study_id, DesignRow.number == number)
        ).one()
        keep_files(session, [StoredArtifact(kind, kind, "x/y", "0" * 64, 5, path)], design_id=design.id)


def end_days_ago(database: Database, study_id: int, days: float) -> None:
    with database.writing() as session:
        ended = time.time() - days * DAY_S
        session.execute(update(StudyRow).where(StudyRow.id == study_id).values(ended_at=ended))


def names(database: Database, settings: Settings, days: float = 90.0) -> list[str]:
    return [Path(item.place).name for item in find_removable(database, settings, Rule(days))]


def test_large_files_of_what_ended_long_ago_go_and_rows_stay(
    sqlite_database: Database, settings: Settings
) -> None:
    study_id = a_finished_study(sqlite_database)
    name_it(sqlite_database, study_id, "vtkhdf", "aa/large")
    name_it(sqlite_database, study_id, "picture", "bb/small")
    large, small = a_file(settings, "aa/large"), a_file(settings, "bb/small")
    end_days_ago(sqlite_database, study_id, 89.0)
    assert names(sqlite_database, settings) == []
    end_days_ago(sqlite_database, study_id, 91.0)
    found = find_removable(sqlite_database, settings, Rule(90.0))
    assert [item.place for item in found] == [str(large)]
    assert large.exists(), "looking removes nothing"
    assert remove(found) == 5
    assert small.exists()
    assert not large.exists()
    with sqlite_database.reading() as session:
        assert len(session.scalars(select(ArtifactRow)).all()) == 2


def test_a_file_that_a_younger_study_names_too_stays(sqlite_database: Database, settings: Settings) -> None:
    old, young = a_finished_study(sqlite_database), a_finished_study(sqlite_database)
    for study_id in (old, young):
        name_it(sqlite_database, study_id, "vtkhdf", "aa/shared")
    a_file(settings, "aa/shared")
    end_days_ago(sqlite_database, old, 1000.0)
    assert names(sqlite_database, settings) == []


def test_a_study_that_is_not_over_keeps_everything(sqlite_database: Database, settings: Settings) -> None:
    study_id, _ = a_simulate_job(sqlite_database)
    name_it(sqlite_database, study_id, "vtkhdf", "aa/large")
    a_file(settings, "aa/large", age_s=1000 * DAY_S)
    assert names(sqlite_database, settings, days=0.0) == []


def test_what_no_row_names_goes_unless_its_row_may_be_coming(
    sqlite_database: Database, settings: Settings
) -> None:
    a_file(settings, "aa/orphan")
    a_file(settings, "aa/fresh", age_s=10.0)
    a_file(settings, ".incoming-x/result.vtkhdf")
    assert names(sqlite_database, settings) == ["result.vtkhdf", "orphan"]


def test_checkpoints_of_open_jobs_stay(sqlite_database: Database, settings: Settings) -> None:
    _, open_job = a_simulate_job(sqlite_database)
    folder = settings.data_dir / "checkpoints"
    over = "00000000-0000-4000-8000-000000000000"
    for name in (open_job, f"{open_job}.previous", over, f"{over}.previous"):
        a_file(settings, f"../checkpoints/{name}")
    series = a_file(settings, f"../checkpoints/{over}.series/spheres").parent
    os.utime(series, (0, 0))
    assert names(sqlite_database, settings) == [over, f"{over}.previous", f"{over}.series"]
    remove(find_removable(sqlite_database, settings, Rule(90.0)))
    assert sorted(path.name for path in folder.iterdir()) == [open_job, f"{open_job}.previous"]


def test_the_command_lists_first_and_removes_only_when_told(
    sqlite_database: Database, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    orphan = a_file(settings, "aa/orphan")
    monkeypatch.setenv("TALUS_DATABASE_URL", sqlite_database.url)
    monkeypatch.setenv("TALUS_DATA_DIR", str(settings.data_dir))
    get_settings.cache_clear()
    try:
        dry = CliRunner().invoke(retention, [])
        assert "nothing was removed" in dry.output
        assert str(orphan) in dry.output
        assert orphan.exists()
        assert "1 files, 0.0 MB removed" in CliRunner().invoke(retention, ["--delete"]).output
        assert not orphan.exists()
    finally:
        get_settings.cache_clear()

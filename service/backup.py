"""A whole installation in one file, and back: `talus backup` while it runs, `talus restore` into an empty one.

The rows are read in one transaction and written into an SQLite file, whatever database they come from; so a
backup needs no pg_dump, and goes back into either database. Files are immutable and stored before the rows that
name them: whatever the rows name is there, as long as the rows are read first.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, Table, func, insert, select, text, update
from sqlalchemy.exc import DBAPIError

from service.db import migrate
from service.db.models import ArtifactRow, Base, GeometryRow, JobRow
from service.db.session import make_engine
from service.domain.states import JobState
from service.file_store import FileStore, artifact_store, geometry_store
from service.settings import Settings

MANIFEST, ROWS = "manifest.json", "talus.db"
FORMAT = 1
CHUNK_ROWS = 500
# The first part of a member's name, and the rows that name such files.
NAMED_BY: dict[str, type[ArtifactRow] | type[GeometryRow]] = {
    "artifacts": ArtifactRow,
    "geometries": GeometryRow,
}
# Who reports to be there now is nobody after a restore.
LEFT_OUT = frozenset({"processes"})


class BackupError(Exception):
    """A backup that cannot be made or taken back; the text is the one line that the user reads."""


@dataclass(frozen=True)
class Summary:
    """What a backup holds. `missing`: files that rows name and that are gone already (retention)."""

    rows: int
    files: int
    bytes: int
    missing: int

    def sentence(self) -> str:
        gone = f"; {self.missing} files were gone already" if self.missing else ""
        return f"{self.rows} rows and {self.files} files, {self.bytes / 1e6:.1f} MB{gone}"


def make_backup(settings: Settings, target: Path) -> Summary:
    """Write everything into the tar file `target`, all or nothing. The service may run. Raises BackupError."""
    if target.exists():
        raise BackupError(f"{target} is there already")
    with tempfile.TemporaryDirectory(prefix=".talus-backup-", dir=target.parent) as name:
        folder = Path(name)
        rows = _dump(settings.resolved_database_url, folder / ROWS)
        files, missing = _files(settings, folder / ROWS)
        manifest = {
            "format": FORMAT,
            "talus": version("talus"),
            "rows": rows,
            "files": files,
            "missing": missing,
        }
        aside = folder / "backup.tar"
        with tarfile.open(aside, "w") as archive:
            _add_bytes(archive, MANIFEST, json.dumps(manifest, indent=1).encode())
            archive.add(folder / ROWS, ROWS)
            for member in files:
                _add_file(archive, member, settings)
        with aside.open("rb") as stream:
            os.fsync(stream.fileno())
            size = os.fstat(stream.fileno()).st_size
        os.replace(aside, target)
    return Summary(sum(rows.values()), len(files), size, len(missing))


def restore_backup(settings: Settings, source: Path) -> Summary:
    """Put a backup into an installation that holds nothing. Its open jobs go on. Raises BackupError."""
    settings.data_dir.mkdir(parents=True, exist_ok=True)
    migrate.upgrade(settings.resolved_database_url)
    with tempfile.TemporaryDirectory(prefix=".talus-restore-", dir=settings.data_dir) as name:
        folder = Path(name)
        manifest, size = _unpack(source, folder)
        migrate.upgrade(f"sqlite:///{folder / ROWS}")
        _move_files(settings, folder, manifest["files"])
        rows = _load(folder / ROWS, settings.resolved_database_url)
    return Summary(rows, len(manifest["files"]), size, len(manifest["missing"]))


def _dump(url: str, path: Path) -> dict[str, int]:
    """All rows as they are at one moment; how many each table has."""
    migrate.upgrade(f"sqlite:///{path}")
    with _engine(url) as source, _engine(f"sqlite:///{path}") as target:
        level = {} if source.dialect.name == "sqlite" else {"isolation_level": "REPEATABLE READ"}
        with source.connect().execution_options(talus_read_only=True, **level) as rows:
            _refuse_old(rows)
            with target.begin() as copy:
                counts = _copy(rows, copy)
        with target.connect() as copy:
            copy.exec_driver_sql("COMMIT")
            copy.exec_driver_sql("PRAGMA journal_mode=DELETE")  # one file, without its log beside it
    return counts


def _refuse_old(rows: Connection) -> None:
    try:
        found = rows.execute(text("select version_num from alembic_version")).scalar()
    except DBAPIError as error:
        raise BackupError("there is no installation in this database") from error
    if found != migrate.newest_revision():
        raise BackupError(f"the database has schema {found}: run `talus migrate` first")


def _copy(source: Connection, target: Connection) -> dict[str, int]:
    counts = {}
    for table in Base.metadata.sorted_tables:
        if table.name in LEFT_OUT:
            continue
        found = source.execution_options(stream_results=True).execute(
            select(table).order_by(*table.primary_key)
        )
        counts[table.name] = 0
        for chunk in found.mappings().partitions(CHUNK_ROWS):
            target.execute(insert(table), [dict(row) for row in chunk])
            counts[table.name] += len(chunk)
    return counts


def _load(path: Path, url: str) -> int:
    with _engine(f"sqlite:///{path}") as source, _engine(url) as target, target.begin() as copy:
        for table in Base.metadata.sorted_tables:
            if copy.execute(select(func.count()).select_from(table)).scalar() and table.name not in LEFT_OUT:
                raise BackupError("this installation holds something already: restore into an empty one")
        with source.connect().execution_options(talus_read_only=True) as rows:
            counts = _copy(rows, copy)
        # Its broker knows nothing of these jobs.
        copy.execute(
            update(JobRow.__table__)  # type: ignore[arg-type]
            .where(JobRow.__table__.c.state == JobState.QUEUED)
            .values(published_at=None, publications=0)
        )
        if target.dialect.name == "postgresql":
            for table in Base.metadata.sorted_tables:
                _set_sequence(copy, table)
    return sum(counts.values())


def _set_sequence(copy: Connection, table: Table) -> None:
    """The next id is beyond those that came with the rows."""
    column = table.autoincrement_column
    if column is not None:
        largest = copy.execute(select(func.max(column))).scalar()
        if largest is not None:
            sequence = func.pg_get_serial_sequence(table.name, column.name)
            copy.execute(select(func.setval(sequence, largest)))


@contextmanager
def _engine(url: str) -> Iterator[Engine]:
    engine = make_engine(url)
    try:
        yield engine
    finally:
        engine.dispose()


def _stores(settings: Settings) -> dict[str, FileStore]:
    return {"artifacts": artifact_store(settings), "geometries": geometry_store(settings)}


def _files(settings: Settings, rows: Path) -> tuple[dict[str, str], list[str]]:
    """Members of the archive with their hash, and the names of those that are gone."""
    found: dict[str, str] = {}
    missing = list[str]()
    with _engine(f"sqlite:///{rows}") as engine, engine.connect() as connection:
        for kind, store in _stores(settings).items():
            row = NAMED_BY[kind]
            for path, sha256 in connection.execute(select(row.path, row.sha256).distinct()):
                member = f"{kind}/{path}"
                if store.size(path) is None:
                    missing.append(member)
                else:
                    found[member] = sha256
    return dict(sorted(found.items())), sorted(missing)


def _unpack(source: Path, folder: Path) -> tuple[dict[str, Any], int]:
    """The manifest and the size, after every byte was found to be what was backed up."""
    try:
        with tarfile.open(source, "r:") as archive:
            archive.extractall(folder, filter="data")
        manifest: dict[str, Any] = json.loads((folder / MANIFEST).read_bytes())
        files = manifest["files"]
        if manifest["format"] != FORMAT or not (folder / ROWS).is_file():
            raise BackupError(f"{source} is a backup of another format")
        for member, sha256 in files.items():
            with (folder / member).open("rb") as stream:
                if hashlib.file_digest(stream, "sha256").hexdigest() != sha256:
                    raise BackupError(f"{source} is damaged: {member} is not what was backed up")
    except (tarfile.TarError, OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise BackupError(f"{source} is no backup of Talus, or is damaged: {error}") from error
    return manifest, source.stat().st_size


def _move_files(settings: Settings, folder: Path, files: dict[str, str]) -> None:
    stores = _stores(settings)
    for member in files:
        kind, _, path = member.partition("/")
        stores[kind].put(folder / member, path)


def _add_file(archive: tarfile.TarFile, member: str, settings: Settings) -> None:
    kind, _, path = member.partition("/")
    store = _stores(settings)[kind]
    info = tarfile.TarInfo(member)
    size = store.size(path)
    if size is None:
        raise BackupError(f"{member} was removed while it was backed up: try again")
    info.size = size
    with store.open(path) as stream:
        archive.addfile(info, stream)


def _add_bytes(archive: tarfile.TarFile, name: str, content: bytes) -> None:
    info = tarfile.TarInfo(name)
    info.size = len(content)
    archive.addfile(info, io.BytesIO(content))

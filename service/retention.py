"""Which stored files may go, and their removal. Rows stay, so that every number is kept.

The store is addressed by content: a file goes only when everything that names it may lose it. What was stored
within the last hour stays, because its row may be about to be written.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import ArtifactRow, ChargeRow, DesignRow, DiagnosisRow, JobRow, StudyRow
from service.db.session import Database
from service.domain.files import LARGE_KINDS
from service.domain.states import OPEN_JOBS
from service.file_store import ASIDE, FileStore, FolderStore, ObjectStore, artifact_store, geometry_store
from service.settings import Settings

DAY_S = 86_400.0
FRESH_S = 3_600.0
CHECKPOINT = "checkpoint of a job that is over"
COPY = "copy of a file in the store"


@dataclass(frozen=True)
class Rule:
    """Files of these kinds go when the study, charge or diagnosis that made them ended so many days ago."""

    older_than_days: float
    kinds: tuple[str, ...] = LARGE_KINDS


@dataclass(frozen=True)
class Removable:
    """A file or folder that may go, and why."""

    place: str
    size_bytes: int
    reason: str
    remove: Callable[[], None]


def find_removable(database: Database, settings: Settings, rule: Rule) -> list[Removable]:
    """What the rule lets go, then what no row names, then what finished jobs left. Removes nothing."""
    with database.reading() as session:
        kept, expired = _stored_paths(session, rule)
        open_jobs = set(session.scalars(select(JobRow.id).where(JobRow.state.in_(OPEN_JOBS))))
    newest = time.time() - FRESH_S
    found = list[Removable]()
    store = artifact_store(settings)
    for file in store.files():
        if file.name in kept or file.modified > newest:
            continue
        reason = (
            f"ended over {rule.older_than_days:g} days ago" if file.name in expired else "no row names it"
        )
        found.append(
            Removable(store.place(file.name), file.size_bytes, reason, partial(store.remove, file.name))
        )
    found += _copies(store, newest) + _copies(geometry_store(settings), newest)
    checkpoints = settings.data_dir / "checkpoints"
    for path in sorted(checkpoints.iterdir()) if checkpoints.is_dir() else ():
        if path.name[:36] not in open_jobs and path.stat().st_mtime <= newest:
            found.append(Removable(str(path), _size(path), CHECKPOINT, partial(_remove_path, path)))
    return found


def remove(found: list[Removable]) -> int:
    """The number of bytes that went."""
    for item in found:
        item.remove()
    return sum(item.size_bytes for item in found)


def _stored_paths(session: Session, rule: Rule) -> tuple[set[str], set[str]]:
    """Paths that some row still wants, and paths whose rows may all lose them."""
    ended = func.coalesce(StudyRow.ended_at, ChargeRow.ended_at, DiagnosisRow.ended_at)
    statement = (
        select(ArtifactRow.path, ArtifactRow.kind, ended)
        .outerjoin(DesignRow, DesignRow.id == ArtifactRow.design_id)
        .outerjoin(StudyRow, StudyRow.id == DesignRow.study_id)
        .outerjoin(ChargeRow, ChargeRow.id == ArtifactRow.charge_id)
        .outerjoin(DiagnosisRow, DiagnosisRow.id == ArtifactRow.diagnosis_id)
    )
    before = queries.now(session) - rule.older_than_days * DAY_S
    kept, expired = set[str](), set[str]()
    for path, kind, ended_at in session.execute(statement):
        may_go = kind in rule.kinds and ended_at is not None and ended_at < before
        (expired if may_go else kept).add(path)
    return kept, expired - kept


def _copies(store: FileStore, newest: float) -> list[Removable]:
    """What this machine keeps of an object store and can fetch again, and halves of it that a killed process left.
    What the store does not have stays: it is from before there was a store, and nowhere else."""
    if not isinstance(store, ObjectStore):
        return []
    copies, kept = FolderStore(store.copies), {file.name: file.size_bytes for file in store.files()}
    return [
        Removable(copies.place(file.name), file.size_bytes, COPY, partial(copies.remove, file.name))
        for file in copies.files()
        if file.modified <= newest and (file.name.startswith(ASIDE) or kept.get(file.name) == file.size_bytes)
    ]


def _size(path: Path) -> int:
    return sum(file.stat().st_size for file in (path, *path.rglob("*")) if file.is_file())


def _remove_path(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)

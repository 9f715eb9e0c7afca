"""Processes that report that they live, for readiness and the health page; no job depends on this."""

from __future__ import annotations

from sqlalchemy import delete, update
from sqlalchemy.orm import Session

from service.db.clock import database_now
from service.db.models import ProcessRow

# A process that was silent for this long is forgotten.
FORGET_AFTER_S = 24 * 3600.0


def report_presence(
    session: Session, process_id: str, role: str, host: str, pid: int, problem: str | None = None
) -> None:
    """First call: the process is there. Later ones: it still is; `problem` is what it cannot do now."""
    statement = (
        update(ProcessRow)
        .where(ProcessRow.id == process_id)
        .values(seen_at=database_now(), problem=problem)
        .returning(ProcessRow.id)
    )
    if session.execute(statement).scalar_one_or_none() is None:
        session.execute(delete(ProcessRow).where(ProcessRow.seen_at < database_now() - FORGET_AFTER_S))
        session.add(ProcessRow(id=process_id, role=role, host=host, pid=pid, problem=problem))


def report_end(session: Session, process_id: str) -> None:
    """The process ends in order."""
    session.execute(delete(ProcessRow).where(ProcessRow.id == process_id))

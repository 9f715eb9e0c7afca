"""Readings of simulated piles by the content of the test: what one diagnosis ran, no other runs again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sqlalchemy import select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.db.models import SimulatorRunRow

# SQLite takes a limited number of parameters in one statement.
AT_ONCE = 500


def find_runs(session: Session, keys: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Those that are stored."""
    found: dict[str, dict[str, Any]] = {}
    for first in range(0, len(keys), AT_ONCE):
        wanted = select(SimulatorRunRow).where(SimulatorRunRow.key.in_(keys[first : first + AT_ONCE]))
        found |= {row.key: row.reading for row in session.scalars(wanted)}
    return found


def store_run(session: Session, key: str, reading: Mapping[str, Any]) -> None:
    """Another worker's equal one is as good."""
    try:
        with session.begin_nested():
            session.add(SimulatorRunRow(key=key, reading=dict(reading)))
            session.flush()
    except IntegrityError:
        return

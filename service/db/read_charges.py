"""Charges with their jobs and files, as the API and the dashboard show them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sqlalchemy import ColumnElement, select
from sqlalchemy.orm import Session

from service.db.models import ArtifactRow, ChargeRow, JobRow


@dataclass(frozen=True)
class ChargeView:
    """A charge with the job that simulates it and its files."""

    charge: ChargeRow
    job: JobRow | None
    artifacts: Sequence[ArtifactRow] = ()


def open_charge(session: Session, charge_id: int) -> ChargeView | None:
    """One charge."""
    found = _views(session, ChargeRow.id == charge_id)
    return found[0] if found else None


def open_series(session: Session, series: int) -> Sequence[ChargeView]:
    """All charges of one request, in the order of their ids."""
    return _views(session, ChargeRow.series == series)[::-1]


def list_charges(
    session: Session, limit: int, before: int | None = None, series: int | None = None
) -> Sequence[ChargeView]:
    """Newest first; `before` is the last id of the page that came before."""
    chosen = select(ChargeRow.id).order_by(ChargeRow.id.desc()).limit(limit)
    if before is not None:
        chosen = chosen.where(ChargeRow.id < before)
    if series is not None:
        chosen = chosen.where(ChargeRow.series == series)
    return _views(session, ChargeRow.id.in_(chosen))


def _views(session: Session, condition: ColumnElement[bool]) -> list[ChargeView]:
    # A charge has one job in its life: retries are attempts of the same job.
    statement = (
        select(ChargeRow, JobRow)
        .outerjoin(JobRow, JobRow.charge_id == ChargeRow.id)
        .where(condition)
        .order_by(ChargeRow.id.desc())
    )
    found = session.execute(statement).all()
    files: dict[int | None, list[ArtifactRow]] = {}
    stored = select(ArtifactRow).join(ChargeRow, ChargeRow.id == ArtifactRow.charge_id).where(condition)
    for artifact in session.scalars(stored.order_by(ArtifactRow.kind)):
        files.setdefault(artifact.charge_id, []).append(artifact)
    return [ChargeView(row[0], row[1], files.get(row[0].id, ())) for row in found]

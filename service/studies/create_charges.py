"""Store charges that were asked for and checked, with a job each."""

from __future__ import annotations

import uuid
from collections.abc import Sequence

from sqlalchemy import select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.db.models import ChargeRow, JobRow
from service.domain.charge import request_hash
from service.domain.states import JobKind
from service.studies.advance_study import ATTEMPTS
from service.studies.check_charges import CheckedCharge
from service.studies.create_study import KeyReused


def create_charges(
    session: Session, checked: Sequence[CheckedCharge], idempotency_key: str | None = None
) -> tuple[list[ChargeRow], bool]:
    """The rows, and whether they are new: the same key and request give the stored ones again.

    Raises KeyReused.
    """
    wanted = request_hash([one.spec for one in checked])
    stored = _stored(session, idempotency_key, wanted)
    if stored:
        return stored, False
    rows = [
        ChargeRow(
            series=0,
            charge=one.spec.charge,
            scale=one.spec.scale,
            seed=one.spec.seed,
            spec=one.spec.as_record(),
            cost=one.cost,
            idempotency_key=idempotency_key if k == 0 else None,
            request_hash=wanted,
        )
        for k, one in enumerate(checked)
    ]
    try:
        # A savepoint: where another request with the same key was faster, only this insert is undone.
        with session.begin_nested():
            session.add_all(rows[:1])
            session.flush()
    except IntegrityError:
        if idempotency_key is None:
            raise
        return _stored(session, idempotency_key, wanted), False
    session.add_all(rows)
    for row in rows:
        row.series = rows[0].id
    session.flush()
    for row in rows:
        session.add(
            JobRow(id=str(uuid.uuid4()), kind=JobKind.CHARGE, charge_id=row.id, max_attempts=ATTEMPTS)
        )
    session.flush()
    return rows, True


def _stored(session: Session, idempotency_key: str | None, wanted: str) -> list[ChargeRow]:
    """The charges of an earlier request with this key; none without one."""
    if idempotency_key is None:
        return []
    found = select(ChargeRow).where(ChargeRow.idempotency_key == idempotency_key)
    first = session.scalars(found).one_or_none()
    if first is None:
        return []
    if first.request_hash != wanted:
        raise KeyReused(f"belongs to charge {first.id}, which was asked for otherwise")
    series = select(ChargeRow).where(ChargeRow.series == first.series).order_by(ChargeRow.id)
    return list(session.scalars(series))

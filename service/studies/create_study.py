"""Store a calibration that was asked for, with its first job."""

from __future__ import annotations

import hashlib
import json

from sqlalchemy import select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.db.models import StudyRow
from service.domain.spec_record import spec_to_record
from service.domain.states import StudyState
from service.domain.study import StudySpec, refuse_tolerance_below_noise
from service.studies.advance_study import advance_study
from service.studies.record_event import record_study_event


class KeyReused(ValueError):
    """The idempotency key belongs to another request."""


def create_study(
    session: Session, spec: StudySpec, idempotency_key: str | None = None
) -> tuple[StudyRow, bool]:
    """The study's row, and whether it is new: the same key and spec give the stored study again.

    Raises InvalidValue for a tolerance under half the noise.
    """
    refuse_tolerance_below_noise(spec)
    record = spec_to_record(spec)
    request_hash = hashlib.sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()
    study = StudyRow(
        state=StudyState.RUNNING,
        material=spec.material,
        spec=record,
        space_hash=spec.space.hash,
        seed=spec.seed,
        budget=spec.budget,
        idempotency_key=idempotency_key,
        request_hash=request_hash,
    )
    try:
        # A savepoint: where another request with the same key was faster, only this insert is undone.
        with session.begin_nested():
            session.add(study)
            session.flush()
    except IntegrityError:
        if idempotency_key is None:
            raise
        stored = session.scalars(select(StudyRow).where(StudyRow.idempotency_key == idempotency_key)).one()
        if stored.request_hash != request_hash:
            raise KeyReused(f"belongs to study {stored.id}, which was asked for otherwise") from None
        return stored, False
    record_study_event(session, study, "study_created")
    advance_study(session, study)
    session.flush()
    return study, True

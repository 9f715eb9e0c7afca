"""Store a calibration that was asked for, with its first job."""

from __future__ import annotations

import hashlib
import json

from sqlalchemy import select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import DesignRow, StudyRow
from service.domain.outcome import judge
from service.domain.spec_record import design_hash, spec_to_record
from service.domain.states import DesignState, StudyState
from service.domain.study import StudySpec, refuse_tolerance_below_noise
from service.studies.advance_study import advance_study
from service.studies.record_event import record_design_event, record_study_event
from service.studies.use_model import use_model
from service.studies.warm_start import check_warm_start, earlier_studies, pooled_noise


class KeyReused(ValueError):
    """The idempotency key belongs to another request."""


def check_study(session: Session, spec: StudySpec) -> StudySpec:
    """The study as it would be stored: with its version of the model looked up. Reads only.

    Raises InvalidValue for a tolerance under half the noise, for a warm start from a study that it cannot start
    from, and for a version of the model that does not fit.
    """
    spec = use_model(session, spec)
    check_warm_start(session, spec)
    refuse_tolerance_below_noise(spec, pooled_noise(earlier_studies(session, spec)))
    return spec


def create_study(
    session: Session, spec: StudySpec, idempotency_key: str | None = None
) -> tuple[StudyRow, bool]:
    """The study's row, and whether it is new: the same key and spec give the stored study again.

    Raises as check_study, and KeyReused.
    """
    spec = check_study(session, spec)
    record = spec_to_record(spec)
    request_hash = hashlib.sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()
    study = StudyRow(
        state=StudyState.RUNNING,
        material=spec.material,
        spec=record,
        space_hash=spec.space_hash,
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
    _add_known_designs(session, study, spec)
    advance_study(session, study)
    session.flush()
    return study, True


def _add_known_designs(session: Session, study: StudyRow, spec: StudySpec) -> None:
    """The rows of the user's table that have results already: finished designs that cost nothing."""
    when = queries.now(session)
    for number, row in enumerate(spec.imported, start=1):
        x, results = tuple(row.x[name] for name in spec.space.names), dict(row.results or {})
        design = DesignRow(
            study_id=study.id,
            number=number,
            x=spec.space.as_dict(x),
            x_hash=design_hash(spec.parameters_of(x)),
            scale=spec.scale,
            # Rows of the same parameters are replicates; how their seeds were called is not known.
            seed=number,
            origin="import",
            reason=f"Known before the study: row {number} of its table that has results.",
            state=DesignState.COMPLETE,
            verdict=judge(spec.responses, results),
            angle_deg=results.get("angle_deg"),
            literal_angle_deg=results.get("literal_angle_deg"),
            responses=results,
            started_at=when,
            ended_at=when,
        )
        session.add(design)
        session.flush()
        record_design_event(session, design, "design_finished")

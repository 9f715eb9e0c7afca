"""Read what the next proposal, or the recommendation, may be based on."""

from __future__ import annotations

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.models import DesignRow, StudyRow
from service.domain.history import FinishedDesign, PendingDesign, StudyHistory
from service.domain.observables import read_observables
from service.domain.spec_record import spec_from_record
from service.domain.states import DesignState, is_over
from service.studies.advance_study import last_seen, next_number


def read_history(session: Session, study: StudyRow) -> StudyHistory:
    """For design n: designs up to `last_seen` as finished, the others as pending even if they are over.

    Cancelled designs are ignored (calibration.md, decision 3).
    """
    number = next_number(session, study.id)
    return _history(session, study, number, basis=last_seen(study, number))


def read_whole_history(session: Session, study: StudyRow) -> StudyHistory:
    """For the recommendation: every design that is over."""
    number = next_number(session, study.id)
    return _history(session, study, number, basis=number - 1)


def _history(session: Session, study: StudyRow, number: int, basis: int) -> StudyHistory:
    spec = spec_from_record(study.spec)
    rows = session.scalars(
        select(DesignRow)
        .where(DesignRow.study_id == study.id, DesignRow.state != DesignState.CANCELLED)
        .order_by(DesignRow.number)
    )
    finished: list[FinishedDesign] = []
    pending: list[PendingDesign] = []
    for row in rows:
        x = tuple(float(row.x[name]) for name in spec.space.names)
        if row.number <= basis and is_over(row.state):
            finished.append(FinishedDesign(row.number, x, row.seed, _results(row), row.origin, row.scale))
        else:
            pending.append(PendingDesign(row.number, x, row.seed, row.origin, row.scale))
    return StudyHistory(spec, number, tuple(finished), tuple(pending))


def _results(row: DesignRow) -> dict[str, float] | None:
    """By observable; None after an error. The angles have columns of their own."""
    if row.state is not DesignState.COMPLETE:
        return None
    angles = {"angle_deg": row.angle_deg, "literal_angle_deg": row.literal_angle_deg}
    return read_observables({**(row.results or {}), **angles})

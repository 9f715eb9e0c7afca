"""Read what the next proposal, or the recommendation, may be based on."""

from __future__ import annotations

from sqlalchemy import select
from sqlalchemy.orm import Session, defer

from service.db.models import DesignRow, StudyRow
from service.domain.history import FinishedDesign, PendingDesign, StudyHistory
from service.domain.noise import expected_of_sectors
from service.domain.observables import ANGLE, NoiseLevel
from service.domain.spec_record import spec_from_record
from service.domain.states import DesignState, is_over
from service.domain.study import StudySpec
from service.studies.advance_study import last_seen, next_number
from service.studies.warm_start import pooled_noise, read_warm_start


def read_history(session: Session, study: StudyRow) -> StudyHistory:
    """For design n: designs up to `last_seen` as finished, the others as pending even if they are over.

    Cancelled designs are ignored (calibration.md, decision 3).
    """
    number = next_number(session, study.id)
    return _history(session, study, number, basis=last_seen(session, study, number))


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
        .options(defer(DesignRow.results, raiseload=True))
    ).all()
    # What was known before the study is seen by all of its proposals.
    seen = [row for row in rows if row.origin == "import" or (row.number <= basis and is_over(row.state))]
    # An error that was repeated with its own seed counts no more, once the repetition's result is seen.
    last = {_key(row): row.number for row in seen}
    numbers = {row.number for row in seen}
    replaced = [row for row in seen if last[_key(row)] != row.number]
    warm = read_warm_start(session, study)
    return StudyHistory(
        spec,
        number,
        finished=tuple(_finished(spec, row) for row in seen if last[_key(row)] == row.number),
        pending=tuple(_pending(spec, row) for row in rows if row.number not in numbers),
        warm=warm,
        noise=_expected_noise(spec, seen) | pooled_noise(warm),
        accepted=study.failures_forgiven,
        replaced=sum(row.origin == "import" or row.scale != spec.scale for row in replaced),
    )


def _expected_noise(spec: StudySpec, seen: list[DesignRow]) -> dict[str, NoiseLevel]:
    """Of the angle, from what single runs tell of themselves; nothing before a few have."""
    expected = expected_of_sectors(row.angle_sd_deg for row in seen if row.scale == spec.scale)
    return {} if expected is None else {ANGLE: expected}


def _key(row: DesignRow) -> tuple[str, float, int]:
    return row.x_hash, row.scale, row.seed


def _finished(spec: StudySpec, row: DesignRow) -> FinishedDesign:
    results = dict(row.responses or {}) if row.state is DesignState.COMPLETE else None
    return FinishedDesign(row.number, _x(spec, row), row.seed, results, row.origin, row.scale)


def _pending(spec: StudySpec, row: DesignRow) -> PendingDesign:
    return PendingDesign(row.number, _x(spec, row), row.seed, row.origin, row.scale)


def _x(spec: StudySpec, row: DesignRow) -> tuple[float, ...]:
    return tuple(float(row.x[name]) for name in spec.space.names)

"""Queue the next job that a study is due, if any: a proposal, or the recommendation at its end.

The rule that makes studies repeatable is here: design n is proposed once all designs up to n - parallel are
over, and sees exactly those. Who finished first, or died on the way, changes nothing.
"""

from __future__ import annotations

import uuid

from sqlalchemy import exists, func, select
from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import DesignRow, JobRow, ProposalRow, StudyRow
from service.domain.states import OPEN_DESIGNS, OPEN_JOBS, DesignState, JobKind, StudyState, require_change
from service.studies.record_event import record_study_event

# Stops that results in flight can take back: not the user's, nor a spent budget that was extended, nor what
# only paused.
REVISABLE = ("certified", "futile", "target_unreachable", "design_complete")

# The first attempt and two more after a lost worker or a want of memory (calibration.md, decision 3).
ATTEMPTS = 3


def advance_study(session: Session, study: StudyRow) -> None:
    """Call it, holding the study's lock, after every change; it adds at most one job."""
    session.flush()
    if study.state is StudyState.RUNNING:
        if not _has_open(session, study, JobKind.PROPOSE) and _is_due(session, study):
            add_job(session, study.id, JobKind.PROPOSE)
    elif study.state in (StudyState.FINISHING, StudyState.CANCELLING):
        if _has_open(session, study):
            return
        if _has_designs(session, study):
            add_job(session, study.id, JobKind.RECOMMEND)
        else:
            end_study(session, study)


def end_study(session: Session, study: StudyRow) -> None:
    """FINISHING -> COMPLETED, CANCELLING -> CANCELLED."""
    ends = {StudyState.FINISHING: StudyState.COMPLETED, StudyState.CANCELLING: StudyState.CANCELLED}
    new = ends[study.state]
    require_change(study.state, new)
    study.state = new
    study.ended_at = queries.now(session)
    record_study_event(session, study, "study_finished")


def add_job(session: Session, study_id: int, kind: JobKind, design_id: int | None = None) -> JobRow:
    """A queued job; the dispatcher publishes it after the commit."""
    job = JobRow(
        id=str(uuid.uuid4()), kind=kind, study_id=study_id, design_id=design_id, max_attempts=ATTEMPTS
    )
    session.add(job)
    return job


def next_number(session: Session, study_id: int) -> int:
    """The number of the design to be proposed next; numbers have no gaps."""
    last = session.scalar(select(func.max(DesignRow.number)).where(DesignRow.study_id == study_id))
    return (last or 0) + 1


def last_seen(session: Session, study: StudyRow, number: int) -> int:
    """The last design whose result the proposal of design `number`, the next one, waits for and sees.

    Once the budget is spent there is only the stop to decide, and that sees every result. So does the decision
    after a stop that the last results took back: with fewer it would stop again.
    """
    sees_all = spent(session, study) >= study.budget or _was_taken_back(session, study.id, number)
    return number - (1 if sees_all else int(study.spec["parallel"]))


def spent(session: Session, study: StudyRow) -> int:
    """Designs that count against the budget: all but those known before and runs at the coarse scale."""
    free = select(func.count()).where(
        DesignRow.study_id == study.id,
        DesignRow.state != DesignState.CANCELLED,
        (DesignRow.origin == "import") | (DesignRow.scale != float(study.spec["scale"])),
    )
    return next_number(session, study.id) - 1 - int(session.scalar(free) or 0)


def _is_due(session: Session, study: StudyRow) -> bool:
    basis = last_seen(session, study, next_number(session, study.id))
    waits = exists().where(
        DesignRow.study_id == study.id, DesignRow.number <= basis, DesignRow.state.in_(OPEN_DESIGNS)
    )
    return not session.scalar(select(waits))


def _was_taken_back(session: Session, study_id: int, number: int) -> bool:
    """Whether the study stopped once instead of proposing design `number`."""
    stopped = exists().where(
        ProposalRow.study_id == study_id,
        ProposalRow.number == number,
        ProposalRow.stop_reason.in_(REVISABLE),
    )
    return bool(session.scalar(select(stopped)))


def _has_open(session: Session, study: StudyRow, kind: JobKind | None = None) -> bool:
    found = exists().where(JobRow.study_id == study.id, JobRow.state.in_(OPEN_JOBS))
    # A report only reads: nothing waits for it.
    found = found.where(JobRow.kind != JobKind.REPORT if kind is None else JobRow.kind == kind)
    return bool(session.scalar(select(found)))


def _has_designs(session: Session, study: StudyRow) -> bool:
    return bool(session.scalar(select(exists().where(DesignRow.study_id == study.id))))

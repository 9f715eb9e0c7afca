"""Record the optimum that a study ends with, and end it; or let it go on, where the last results ask for it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sqlalchemy.orm import Session

from service.db.models import StudyRow
from service.db.queries import Lease
from service.domain.history import ProposedDesign, StudyStop
from service.domain.outcome import RunCost
from service.domain.states import JobState, StudyState, is_over, require_change
from service.studies.advance_study import advance_study, end_study
from service.studies.close_run import close_run
from service.studies.finish_job import finish_job
from service.studies.record_event import record_study_event
from service.studies.record_proposal import PAUSING
from service.studies.request_report import request_report


def record_recommendation(
    session: Session,
    lease: Lease,
    recommendation: Mapping[str, Any] | None,
    answer: ProposedDesign | StudyStop | None = None,
    cost: RunCost | None = None,
) -> bool:
    """False: the lease was lost, nothing is written. `recommendation` None: no design has an angle.

    answer: what the strategy says now that every result is there; None where it was not asked. A study stopped
    with designs in flight, and their results may take back what it stopped for: then it goes on, as if it had
    not stopped. Otherwise the answer's words replace those of that moment. A user's stop stays as it is.
    """
    ended = finish_job(session, lease, JobState.DONE)
    if ended is None:
        return False
    close_run(session, lease, "done", cost=cost)
    study = ended.study
    if is_over(study.state):
        return True
    if study.state is StudyState.FINISHING and answer is not None:
        if isinstance(answer, ProposedDesign) or answer.reason in PAUSING:
            _go_on(session, study)
            return True
        study.stop_reason, study.stop_text, study.stop_numbers = (
            answer.reason,
            answer.text,
            dict(answer.numbers),
        )
    study.recommendation = dict(recommendation) if recommendation is not None else None
    end_study(session, study)
    if recommendation is not None:
        request_report(session, study.id)
    return True


def _go_on(session: Session, study: StudyRow) -> None:
    require_change(study.state, StudyState.RUNNING)
    study.state = StudyState.RUNNING
    study.stop_reason = study.stop_text = study.stop_numbers = None
    record_study_event(session, study, "study_goes_on")
    advance_study(session, study)

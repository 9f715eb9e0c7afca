"""Stop a study because its user says so; what it has measured stays and is judged."""

from __future__ import annotations

from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import StudyRow
from service.domain.states import StudyState, require_change
from service.studies.advance_study import advance_study
from service.studies.record_event import record_study_event
from service.studies.withdraw_jobs import withdraw_jobs


def cancel_study(session: Session, study_id: int) -> StudyRow | None:
    """None: no such study. Raises ChangeNotAllowed when it has ended otherwise; asking twice is fine."""
    study = queries.lock_study(session, study_id)
    if study is None or study.state in (StudyState.CANCELLING, StudyState.CANCELLED):
        return study
    require_change(study.state, StudyState.CANCELLING)
    study.state = StudyState.CANCELLING
    study.stop_reason, study.stop_text, study.stop_numbers = "user", "Cancelled by the user.", None
    study.pause_reason = study.pause_text = study.pause_numbers = None
    record_study_event(session, study, "study_stopping")
    withdraw_jobs(session, study)
    advance_study(session, study)
    return study

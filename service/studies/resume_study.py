"""Resume a paused study."""

from __future__ import annotations

from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import StudyRow
from service.domain.states import ActionNotAllowed, StudyState, require_change
from service.studies.advance_study import advance_study, next_number
from service.studies.record_event import record_study_event


def resume_study(session: Session, study_id: int) -> StudyRow | None:
    """None: no such study. Raises ActionNotAllowed unless it is paused; asking twice is fine.

    Failures that paused it, or happened until now, are forgiven: only later ones can pause it again.
    """
    study = queries.lock_study(session, study_id)
    if study is None or study.state is StudyState.RUNNING:
        return study
    if study.state is not StudyState.PAUSED:
        raise ActionNotAllowed(
            f"only a paused study can be resumed, and study {study_id} is {study.state.value}"
        )
    if study.pause_reason != "user":
        study.failures_forgiven = next_number(session, study.id) - 1
    require_change(study.state, StudyState.RUNNING)
    study.state = StudyState.RUNNING
    study.pause_reason = study.pause_text = study.pause_numbers = None
    record_study_event(session, study, "study_resumed")
    queries.publish_again(session, study.id)
    advance_study(session, study)
    return study

"""Pause a study: nothing new is proposed or started until it is resumed; what runs comes to its end."""

from __future__ import annotations

from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import StudyRow
from service.domain.history import StudyStop
from service.domain.states import StudyState, require_change
from service.studies.record_event import record_study_event
from service.studies.withdraw_jobs import withdraw_decision

BY_USER = StudyStop("user", "Paused by the user.", {})


def pause_study(session: Session, study_id: int) -> StudyRow | None:
    """None: no such study. Raises ChangeNotAllowed unless it runs; asking twice is fine."""
    study = queries.lock_study(session, study_id)
    if study is None or study.state is StudyState.PAUSED:
        return study
    pause(session, study, BY_USER)
    return study


def pause(session: Session, study: StudyRow, why: StudyStop) -> None:
    """Needs the study's lock. An open proposal is withdrawn: resuming asks for it anew, with the same answer."""
    require_change(study.state, StudyState.PAUSED)
    study.state = StudyState.PAUSED
    study.pause_reason, study.pause_text, study.pause_numbers = why.reason, why.text, dict(why.numbers)
    withdraw_decision(session, study, "the study was paused")
    record_study_event(session, study, "study_paused")

"""Tell what happened: a row that event streams and the dashboard read."""

from __future__ import annotations

from typing import Any

from sqlalchemy.orm import Session

from service.db.models import DesignRow, EventRow, StudyRow


def record_event(session: Session, study_id: int, kind: str, data: dict[str, Any]) -> None:
    """Add the event. The caller holds the study's lock, so that ids appear in order."""
    session.add(EventRow(study_id=study_id, kind=kind, data=data))


def record_study_event(session: Session, study: StudyRow, kind: str) -> None:
    """The study's state, budget, counters and reasons as they are now."""
    data = {
        "study_id": study.id,
        "state": study.state.value,
        "counters": {"feasible": study.feasible, "unfeasible": study.unfeasible, "error": study.error},
        "budget": study.budget,
        "stop_reason": study.stop_reason,
        "stop_text": study.stop_text,
        "pause_reason": study.pause_reason,
        "pause_text": study.pause_text,
    }
    record_event(session, study.id, kind, data)


def record_design_event(session: Session, design: DesignRow, kind: str, **more: Any) -> None:
    """The design's state, parameters and result as they are now."""
    data = {
        "design_id": design.id,
        "number": design.number,
        "state": design.state.value,
        "x": design.x,
        "seed": design.seed,
        "origin": design.origin,
        "reason": design.reason,
        "prediction": design.prediction,
        "verdict": design.verdict.value if design.verdict else None,
        "angle_deg": design.angle_deg,
        "angle_sd_deg": design.angle_sd_deg,
        "failure_class": design.failure_class,
        "failure_text": design.failure_text,
        **more,
    }
    record_event(session, design.study_id, kind, data)

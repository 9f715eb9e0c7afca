"""Record the optimum that a study ends with, and end it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sqlalchemy.orm import Session

from service.db.queries import Lease
from service.domain.history import StudyStop
from service.domain.outcome import RunCost
from service.domain.states import JobState, is_over
from service.studies.advance_study import end_study
from service.studies.close_run import close_run
from service.studies.finish_job import finish_job
from service.studies.request_report import request_report


def record_recommendation(
    session: Session,
    lease: Lease,
    recommendation: Mapping[str, Any] | None,
    stop: StudyStop | None = None,
    cost: RunCost | None = None,
) -> bool:
    """False: the lease was lost, nothing is written. `recommendation` None: no design has an angle.

    stop: the strategy's answer to all results. Where its reason is the one for which the study stopped, its text
    and numbers replace those of a moment when designs were still running; another reason (the user's, or one
    that the last results no longer bear out) leaves what was said.
    """
    ended = finish_job(session, lease, JobState.DONE)
    if ended is None:
        return False
    close_run(session, lease, "done", cost=cost)
    if not is_over(ended.study.state):
        if stop is not None and stop.reason == ended.study.stop_reason:
            ended.study.stop_text, ended.study.stop_numbers = stop.text, dict(stop.numbers)
        ended.study.recommendation = dict(recommendation) if recommendation is not None else None
        end_study(session, ended.study)
        if recommendation is not None:
            request_report(session, ended.study.id)
    return True

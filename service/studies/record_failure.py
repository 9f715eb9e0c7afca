"""Record that a job failed for good: an error for a design, charge or diagnosis, the study's end for others."""

from __future__ import annotations

from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import DesignRow, StudyRow, TaskRow
from service.db.queries import Lease
from service.domain.outcome import Failure, RunCost
from service.domain.states import DesignState, JobKind, JobState, StudyState, Verdict, require_change
from service.studies.advance_study import advance_study
from service.studies.close_run import close_run
from service.studies.finish_job import FinishedJob, finish_job
from service.studies.move_task import move_task
from service.studies.record_event import record_design_event, record_study_event
from service.studies.withdraw_jobs import withdraw_jobs


def record_failure(session: Session, lease: Lease, failure: Failure, cost: RunCost | None = None) -> bool:
    """False: the lease was lost, nothing is written."""
    ended = finish_job(session, lease, JobState.FAILED, failure.text)
    if ended is None:
        return False
    settle_failure(session, ended, lease, failure, cost)
    return True


def settle_failure(
    session: Session, ended: FinishedJob, lease: Lease, failure: Failure, cost: RunCost | None = None
) -> None:
    """What follows from a job that is failed already (the reaper fails one that was lost too often)."""
    close_run(session, lease, failure.failure_class.value, failure.text, cost)
    if isinstance(ended.owner, TaskRow):
        move_task(session, ended.owner, DesignState.FAILED, failure)
    elif ended.design is not None:
        _fail_design(session, ended.study, ended.design, failure)
        advance_study(session, ended.study)
    elif ended.job.kind is not JobKind.REPORT:  # a report that fails is missing, no more
        fail_study(session, ended.study, f"the {ended.job.kind.value} job failed: {failure.text}")


def fail_study(session: Session, study: StudyRow, text: str) -> None:
    """A study that can neither propose nor recommend ends here; what it measured stays."""
    require_change(study.state, StudyState.FAILED)
    study.state = StudyState.FAILED
    study.stop_reason, study.stop_text = "error", text
    study.ended_at = queries.now(session)
    withdraw_jobs(session, study)
    record_study_event(session, study, "study_finished")


def _fail_design(session: Session, study: StudyRow, design: DesignRow, failure: Failure) -> None:
    require_change(design.state, DesignState.FAILED)
    design.state = DesignState.FAILED
    design.ended_at = queries.now(session)
    design.verdict = Verdict.ERROR
    design.failure_class = failure.failure_class.value
    design.failure_text = failure.text
    study.error += 1
    record_design_event(session, design, "design_finished")

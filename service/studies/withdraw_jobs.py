"""Take back a study's open jobs: queued ones end at once, running ones are asked to stop."""

from __future__ import annotations

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import ChargeRow, DesignRow, DiagnosisRow, JobRow, StudyRow
from service.db.queries import Lease
from service.domain.states import OPEN_JOBS, DesignState, JobKind, JobState, require_change
from service.studies.close_run import close_run
from service.studies.move_task import move_task
from service.studies.record_event import record_design_event


def withdraw_jobs(session: Session, study: StudyRow) -> None:
    """Needs the study's lock. A recommendation under way is let through: it ends the study soonest."""
    open_jobs = select(JobRow).where(
        JobRow.study_id == study.id, JobRow.state.in_(OPEN_JOBS), JobRow.kind != JobKind.RECOMMEND
    )
    for job in session.scalars(open_jobs).all():
        withdraw_job(session, job)


def withdraw_decision(session: Session, study: StudyRow, why: str) -> None:
    """Fence off an open proposal or recommendation: what it is based on changes. Its worker discards it.

    Needs the study's lock; `advance_study` then asks anew.
    """
    open_jobs = select(JobRow).where(
        JobRow.study_id == study.id,
        JobRow.state.in_(OPEN_JOBS),
        JobRow.kind.in_((JobKind.PROPOSE, JobKind.RECOMMEND)),
    )
    for job in session.scalars(open_jobs).all():
        if queries.withdraw(session, job.id):
            close_run(session, Lease(job.id, job.attempt), "cancelled", why)


def withdraw_job(session: Session, job: JobRow) -> bool:
    """False: the job was over already. Needs its owner's lock."""
    if job.state is JobState.QUEUED and queries.cancel_queued(session, job.id):
        if job.charge_id is not None:
            charge = session.get_one(ChargeRow, job.charge_id, populate_existing=True)
            move_task(session, charge, DesignState.CANCELLED)
        if job.diagnosis_id is not None:
            diagnosis = session.get_one(DiagnosisRow, job.diagnosis_id, populate_existing=True)
            move_task(session, diagnosis, DesignState.CANCELLED)
        if job.design_id is not None:
            cancel_design(session, session.get_one(DesignRow, job.design_id, populate_existing=True))
        return True
    return queries.ask_to_cancel(session, job.id)


def cancel_design(session: Session, design: DesignRow) -> None:
    """WAITING or RUNNING -> CANCELLED: it has no verdict and no proposal sees it."""
    require_change(design.state, DesignState.CANCELLED)
    design.state = DesignState.CANCELLED
    design.ended_at = queries.now(session)
    record_design_event(session, design, "design_finished")

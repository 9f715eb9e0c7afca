"""What pages and the API show, read in few statements: rows are shown, nothing is computed from physics.

Lists go by keyset: a page begins after the last id that the client has, so that it stays fast at any depth
and does not shift when rows are added.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sqlalchemy import ColumnElement, func, select, tuple_
from sqlalchemy.orm import Session

from service.db.clock import database_now
from service.db.models import (
    ArtifactRow,
    DesignRow,
    EventRow,
    JobRow,
    ProcessRow,
    ProposalRow,
    ReportRow,
    RunRow,
    StudyRow,
    SurrogateRow,
)
from service.domain.spec_record import primary_response
from service.domain.states import OPEN_JOBS, JobKind, JobState


@dataclass(frozen=True)
class DesignView:
    """A design with the job that simulates it, its files, and the optimizer's proposal that it came from."""

    design: DesignRow
    job: JobRow | None
    proposal: ProposalRow | None = None
    surrogate: SurrogateRow | None = None
    artifacts: Sequence[ArtifactRow] = ()


@dataclass(frozen=True)
class StudyPage:
    """A study with its designs in the order of their numbers."""

    study: StudyRow
    designs: Sequence[DesignView]

    @property
    def best(self) -> DesignView | None:
        """The design whose observed angle is nearest to the target; the first of equals."""
        target = float(primary_response(self.study.spec)["target"])
        seen = [(abs(d.design.angle_deg - target), d) for d in self.designs if d.design.angle_deg is not None]
        return min(seen, key=lambda pair: pair[0])[1] if seen else None


def open_study(session: Session, study_id: int) -> StudyPage | None:
    """Everything that a study's page shows, in three statements whatever the number of designs."""
    study = session.get(StudyRow, study_id)
    return None if study is None else StudyPage(study, _design_views(session, DesignRow.study_id == study_id))


def open_design(session: Session, design_id: int) -> DesignView | None:
    """One design with its job and files."""
    views = _design_views(session, DesignRow.id == design_id)
    return views[0] if views else None


def list_studies(session: Session, limit: int, before: int | None = None) -> Sequence[StudyRow]:
    """Newest first; `before` is the last id of the page that came before."""
    statement = select(StudyRow).order_by(StudyRow.id.desc()).limit(limit)
    if before is not None:
        statement = statement.where(StudyRow.id < before)
    return session.scalars(statement).all()


def list_designs(session: Session, study_id: int, limit: int, after: int = 0) -> Sequence[DesignView]:
    """By number; `after` is the last number of the page that came before."""
    chosen = (
        select(DesignRow.id)
        .where(DesignRow.study_id == study_id, DesignRow.number > after)
        .order_by(DesignRow.number)
        .limit(limit)
    )
    return _design_views(session, DesignRow.id.in_(chosen))


def list_jobs(
    session: Session,
    limit: int,
    before: tuple[float, str] | None = None,
    state: JobState | None = None,
    study_id: int | None = None,
) -> Sequence[JobRow]:
    """Newest first; `before` is (created_at, id) of the last job of the page that came before."""
    statement = select(JobRow).order_by(JobRow.created_at.desc(), JobRow.id.desc()).limit(limit)
    if before is not None:
        statement = statement.where(tuple_(JobRow.created_at, JobRow.id) < before)
    if state is not None:
        statement = statement.where(JobRow.state == state)
    if study_id is not None:
        statement = statement.where(JobRow.study_id == study_id)
    return session.scalars(statement).all()


def runs_of_job(session: Session, job_id: str) -> Sequence[RunRow]:
    """Every attempt at a job, the first one first."""
    return session.scalars(select(RunRow).where(RunRow.job_id == job_id).order_by(RunRow.attempt)).all()


def costs_of_study(session: Session, study_id: int) -> Mapping[str, float]:
    """Wall-clock seconds of all attempts at each simulation, by job."""
    statement = (
        select(RunRow.job_id, func.sum(RunRow.wall_s))
        .join(JobRow, JobRow.id == RunRow.job_id)
        .where(JobRow.study_id == study_id, JobRow.design_id.is_not(None), RunRow.wall_s.is_not(None))
        .group_by(RunRow.job_id)
    )
    return {row[0]: float(row[1] or 0.0) for row in session.execute(statement)}


def artifacts_of_design(session: Session, design_id: int) -> Sequence[ArtifactRow]:
    """The files of a design, by kind."""
    statement = select(ArtifactRow).where(ArtifactRow.design_id == design_id).order_by(ArtifactRow.kind)
    return session.scalars(statement).all()


def events_after(session: Session, study_id: int, after: int, limit: int = 500) -> Sequence[EventRow]:
    """What happened to a study since the event `after`, in order."""
    statement = (
        select(EventRow)
        .where(EventRow.study_id == study_id, EventRow.id > after)
        .order_by(EventRow.id)
        .limit(limit)
    )
    return session.scalars(statement).all()


def running_designs(session: Session, study_id: int) -> Sequence[tuple[int, JobRow]]:
    """The numbers of the designs that are simulated right now, with their jobs (and those jobs' progress)."""
    statement = (
        select(DesignRow.number, JobRow)
        .join(JobRow, JobRow.design_id == DesignRow.id)
        .where(DesignRow.study_id == study_id, JobRow.state == JobState.RUNNING)
        .order_by(DesignRow.number)
    )
    return [(row[0], row[1]) for row in session.execute(statement)]


def newest_report(session: Session, study_id: int) -> ReportRow | None:
    """What was last reported of a study, None before any."""
    statement = select(ReportRow).where(ReportRow.study_id == study_id).order_by(ReportRow.id.desc()).limit(1)
    return session.scalars(statement).one_or_none()


def has_ended_since(session: Session, study_id: int, when: float) -> bool:
    """A design of the study ended after `when`."""
    later = select(DesignRow.id).where(DesignRow.study_id == study_id, DesignRow.ended_at > when)
    return session.scalars(later.limit(1)).one_or_none() is not None


def has_open_report(session: Session, study_id: int) -> bool:
    """A report on the study is asked for or being written."""
    statement = select(JobRow.id).where(
        JobRow.study_id == study_id, JobRow.kind == JobKind.REPORT, JobRow.state.in_(OPEN_JOBS)
    )
    return session.scalars(statement.limit(1)).one_or_none() is not None


def seen_lately(session: Session, role: str, seconds: float) -> Sequence[ProcessRow]:
    """Processes of a role that reported within the last `seconds` of the database's clock."""
    statement = select(ProcessRow).where(
        ProcessRow.role == role, ProcessRow.seen_at > database_now() - seconds
    )
    return session.scalars(statement).all()


def job_counts(session: Session) -> Mapping[JobState, int]:
    """How many jobs are in each state; states without any are left out."""
    statement = select(JobRow.state, func.count()).group_by(JobRow.state)
    return {row[0]: row[1] for row in session.execute(statement)}


def _design_views(session: Session, condition: ColumnElement[bool]) -> list[DesignView]:
    # A design has one job in its life: retries are attempts of the same job.
    proposed = (ProposalRow.study_id == DesignRow.study_id) & (ProposalRow.chosen == DesignRow.number)
    statement = (
        select(DesignRow, JobRow, ProposalRow, SurrogateRow)
        .outerjoin(JobRow, JobRow.design_id == DesignRow.id)
        .outerjoin(ProposalRow, proposed)
        .outerjoin(SurrogateRow, SurrogateRow.id == ProposalRow.surrogate_id)
        .where(condition)
        .order_by(DesignRow.number)
    )
    found = session.execute(statement).all()
    files: dict[int, list[ArtifactRow]] = {}
    stored = select(ArtifactRow).join(DesignRow, DesignRow.id == ArtifactRow.design_id).where(condition)
    for artifact in session.scalars(stored.order_by(ArtifactRow.kind)):
        assert artifact.design_id is not None, "joined by it"
        files.setdefault(artifact.design_id, []).append(artifact)
    return [DesignView(row[0], row[1], row[2], row[3], files.get(row[0].id, ())) for row in found]

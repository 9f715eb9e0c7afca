"""What the dashboard's pages read beyond `read_models`: light rows, open work and the state of the processes.

Designs come without their results (a profile each): a study of 500 designs is then a light page.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from sqlalchemy import func, select
from sqlalchemy.orm import Session, defer

from service.db import queries, read_models
from service.db.models import (
    ChargeRow,
    DataSetRow,
    DesignRow,
    DiagnosisRow,
    EventRow,
    JobRow,
    ProcessRow,
    RunRow,
    StudyRow,
)
from service.domain.states import OPEN_JOBS, JobState

# Workers and dispatchers report every few seconds; after this long without, they count as gone.
SILENCE_S = 15.0
MOST_JOBS = 40
EVENTS_AT_ONCE = 500


@dataclass(frozen=True)
class OpenJob:
    """A job that is queued or running; `number` is its design's, `started_at` its present attempt's."""

    job: JobRow
    number: int | None
    material: str
    started_at: float | None

    @property
    def is_running(self) -> bool:
        return self.job.state is JobState.RUNNING


@dataclass(frozen=True)
class Health:
    """Processes that reported lately, and how many jobs wait and run."""

    workers: Sequence[ProcessRow]
    dispatchers: Sequence[ProcessRow]
    queued: int
    running: int


@dataclass(frozen=True)
class Observed:
    """The angle of one finished simulation."""

    number: int
    angle_deg: float
    angle_sd_deg: float | None


@dataclass(frozen=True)
class StudySnapshot:
    """A study's rows at one moment; `cursor` is the last event that they include."""

    study: StudyRow
    designs: Sequence[DesignRow]
    jobs: Sequence[OpenJob]
    cursor: int
    now: float


def open_study(session: Session, study_id: int) -> StudySnapshot | None:
    """Everything but results, in five statements whatever the number of designs."""
    study = session.get(StudyRow, study_id)
    if study is None:
        return None
    # The cursor first: what is told twice is drawn twice, what is missed stays missing.
    cursor = session.scalar(select(func.max(EventRow.id)).where(EventRow.study_id == study_id))
    designs = session.scalars(
        select(DesignRow)
        .where(DesignRow.study_id == study_id)
        .order_by(DesignRow.number)
        .options(defer(DesignRow.results, raiseload=True))
    ).all()
    return StudySnapshot(study, designs, open_jobs(session, study_id), cursor or 0, queries.now(session))


def changed_designs(session: Session, study_id: int, after: int) -> frozenset[int] | None:
    """Numbers of the designs that something happened to since the event `after`; None: too many to say."""
    rows = read_models.events_after(session, study_id, after, EVENTS_AT_ONCE)
    if len(rows) == EVENTS_AT_ONCE:
        return None
    return frozenset(int(row.data["number"]) for row in rows if "number" in row.data)


def open_jobs(
    session: Session, study_id: int | None = None, charge_id: int | None = None
) -> Sequence[OpenJob]:
    """All, or those of one owner: running ones first, then the longest waiting; at most MOST_JOBS."""
    statement = (
        select(
            JobRow,
            DesignRow.number,
            func.coalesce(StudyRow.material, ChargeRow.charge, DataSetRow.name),
            RunRow.started_at,
        )
        .outerjoin(StudyRow, StudyRow.id == JobRow.study_id)
        .outerjoin(ChargeRow, ChargeRow.id == JobRow.charge_id)
        .outerjoin(DiagnosisRow, DiagnosisRow.id == JobRow.diagnosis_id)
        .outerjoin(DataSetRow, DataSetRow.id == DiagnosisRow.data_set_id)
        .outerjoin(DesignRow, DesignRow.id == JobRow.design_id)
        .outerjoin(RunRow, (RunRow.job_id == JobRow.id) & (RunRow.attempt == JobRow.attempt))
        .where(JobRow.state.in_(OPEN_JOBS))
        .order_by(JobRow.state.desc(), JobRow.created_at, JobRow.id)
        .limit(MOST_JOBS)
    )
    if study_id is not None:
        statement = statement.where(JobRow.study_id == study_id)
    if charge_id is not None:
        statement = statement.where(JobRow.charge_id == charge_id)
    return [OpenJob(row[0], row[1], row[2], row[3]) for row in session.execute(statement)]


def health(session: Session) -> Health:
    """Who works, and how much waits."""
    counts = read_models.job_counts(session)
    return Health(
        workers=read_models.seen_lately(session, "worker", SILENCE_S),
        dispatchers=read_models.seen_lately(session, "dispatcher", SILENCE_S),
        queued=counts.get(JobState.QUEUED, 0),
        running=counts.get(JobState.RUNNING, 0),
    )


def observed_angles(session: Session, study_ids: Collection[int]) -> Mapping[int, Sequence[Observed]]:
    """The angles of several studies, by study and number."""
    statement = (
        select(DesignRow.study_id, DesignRow.number, DesignRow.angle_deg, DesignRow.angle_sd_deg)
        .where(DesignRow.study_id.in_(study_ids), DesignRow.angle_deg.is_not(None))
        .order_by(DesignRow.study_id, DesignRow.number)
    )
    found: dict[int, list[Observed]] = {}
    for study_id, number, angle, sd in session.execute(statement):
        if angle is not None:
            found.setdefault(study_id, []).append(Observed(number, angle, sd))
    return found


def ended_since(session: Session, since: float, limit: int) -> Sequence[StudyRow | ChargeRow | DiagnosisRow]:
    """What ended after `since` (seconds since 1970), of every kind, newest first."""
    found: list[StudyRow | ChargeRow | DiagnosisRow] = []
    for kind in (StudyRow, ChargeRow, DiagnosisRow):
        statement = select(kind).where(kind.ended_at > since).order_by(kind.ended_at.desc()).limit(limit)
        found.extend(session.scalars(statement))
    return sorted(found, key=lambda row: row.ended_at or 0.0, reverse=True)[:limit]

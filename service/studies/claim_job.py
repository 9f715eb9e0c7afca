"""Take a job that a message told of, and everything that is needed to do it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import (
    ChargeRow,
    DataSetRow,
    DesignRow,
    DiagnosisRow,
    JobRow,
    NullCalibrationRow,
    RunRow,
    StudyRow,
)
from service.db.queries import Lease
from service.domain.charge import ChargeSpec
from service.domain.data_set.records import DataSet
from service.domain.data_set.stored import from_record
from service.domain.diagnosis import DiagnosisSpec
from service.domain.history import StudyHistory
from service.domain.spec_record import spec_from_record
from service.domain.states import DesignState, JobKind, StudyState, require_change
from service.domain.study import StudySpec
from service.studies.move_task import move_task
from service.studies.read_history import read_history, read_whole_history
from service.studies.record_event import record_design_event


@dataclass(frozen=True)
class Claim:
    """A claimed job. `x`, `seed` and `scale` are of the design to simulate; `history` is for the other kinds."""

    lease: Lease
    kind: JobKind
    study_id: int
    spec: StudySpec
    time_step_factor: float
    attempts_left: int
    design_id: int | None = None
    design_number: int | None = None
    x: tuple[float, ...] = ()
    seed: int = 0
    scale: float = 1.0
    history: StudyHistory | None = None


@dataclass(frozen=True)
class ChargeClaim:
    """A claimed charge."""

    lease: Lease
    charge_id: int
    spec: ChargeSpec
    time_step_factor: float
    attempts_left: int
    kind: JobKind = JobKind.CHARGE


@dataclass(frozen=True)
class DiagnosisClaim:
    """A claimed diagnosis: its data set, and the null calibrations that earlier ones made, by their keys."""

    lease: Lease
    diagnosis_id: int
    spec: DiagnosisSpec
    data: DataSet
    calibrations: Mapping[str, Mapping[str, Any]]
    attempts_left: int
    time_step_factor: float = 1.0
    kind: JobKind = JobKind.DIAGNOSE


AnyClaim = Claim | ChargeClaim | DiagnosisClaim


def claim_job(session: Session, job_id: str, worker_id: str, lease_s: float) -> AnyClaim | None:
    """None when there is nothing to claim: the message was a duplicate, forged, or came too late."""
    owner = queries.lock_owner(session, job_id)
    if owner is None or (isinstance(owner, StudyRow) and _is_held(session, owner, job_id)):
        return None
    job = queries.claim(session, job_id, worker_id, lease_s)
    if job is None:
        return None
    session.add(
        RunRow(job_id=job.id, attempt=job.attempt, worker_id=worker_id, time_step_factor=job.time_step_factor)
    )
    lease, left = Lease(job.id, job.attempt), job.max_attempts - job.attempt
    if isinstance(owner, ChargeRow):
        move_task(session, owner, DesignState.RUNNING)
        return ChargeClaim(lease, owner.id, ChargeSpec.from_record(owner.spec), job.time_step_factor, left)
    if isinstance(owner, DiagnosisRow):
        move_task(session, owner, DesignState.RUNNING)
        return _claim_of_diagnosis(session, owner, lease, left)
    return _claim_of_study(session, owner, job, lease, left)


def _claim_of_diagnosis(session: Session, owner: DiagnosisRow, lease: Lease, left: int) -> DiagnosisClaim:
    data_set = session.get_one(DataSetRow, owner.data_set_id)
    calibrations = {row.key: row.content for row in session.scalars(select(NullCalibrationRow))}
    spec = DiagnosisSpec.from_record(owner.spec)
    return DiagnosisClaim(lease, owner.id, spec, from_record(data_set.content), calibrations, left)


def _claim_of_study(session: Session, study: StudyRow, job: JobRow, lease: Lease, left: int) -> Claim:
    spec = spec_from_record(study.spec)
    if job.kind is not JobKind.SIMULATE:
        read = read_history if job.kind is JobKind.PROPOSE else read_whole_history
        history = read(session, study)
        return Claim(lease, job.kind, study.id, spec, job.time_step_factor, left, history=history)
    design = session.get_one(DesignRow, job.design_id)
    require_change(design.state, DesignState.RUNNING)
    design.state = DesignState.RUNNING
    design.started_at = queries.now(session)
    record_design_event(session, design, "design_started", attempt=job.attempt)
    x = tuple(float(design.x[name]) for name in spec.space.names)
    factor = job.time_step_factor
    run = (design.id, design.number, x, design.seed, design.scale)
    return Claim(lease, job.kind, study.id, spec, factor, left, *run)


def _is_held(session: Session, study: StudyRow, job_id: str) -> bool:
    """A paused study keeps its jobs queued; resuming publishes them again."""
    if study.state is not StudyState.PAUSED:
        return False
    return session.get_one(JobRow, job_id).kind not in queries.CLAIMED_WHILE_PAUSED

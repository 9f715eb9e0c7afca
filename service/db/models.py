"""The tables. Everything that was asked for, computed or lost is a row here.

Times are seconds since 1970 by the database's clock (`clock.database_now`). Numbers outside SI say so in
their names. JSON columns hold plain JSON: no NaN, no pickles.
"""

from __future__ import annotations

from typing import Any

from sqlalchemy import CheckConstraint, ForeignKey, Index, String, Text, UniqueConstraint, text
from sqlalchemy.orm import Mapped, mapped_column

from service.db.base import Base, Id, OfProject, stored_enum
from service.db.charge_models import ChargeRow, GeometryRow
from service.db.clock import database_now
from service.db.diagnosis_models import (
    ClaimCheckRow,
    DataSetRow,
    DiagnosisRow,
    ModelVersionRow,
    NullCalibrationRow,
    SimulatorRunRow,
)
from service.domain.access import Scope
from service.domain.states import DesignState, JobKind, JobState, StudyState, Verdict

__all__ = [
    "ApiKeyRow",
    "ArtifactRow",
    "Base",
    "BudgetChangeRow",
    "ChargeRow",
    "ClaimCheckRow",
    "DataSetRow",
    "DesignRow",
    "DiagnosisRow",
    "EventRow",
    "GeometryRow",
    "JobRow",
    "ModelVersionRow",
    "NullCalibrationRow",
    "ProcessRow",
    "ProposalRow",
    "ReportRow",
    "RunRow",
    "SimulatorRunRow",
    "StudyRow",
    "SurrogateRow",
    "TaskRow",
]

# What a job of its own carries out, beside the studies with their many.
TaskRow = ChargeRow | DiagnosisRow


def _one_owner(first: str) -> str:
    """A job or a file belongs to exactly one thing: a truth is no number on PostgreSQL."""
    counted = (
        f"(case when {name} is null then 0 else 1 end)" for name in (first, "charge_id", "diagnosis_id")
    )
    return " + ".join(counted) + " = 1"


class StudyRow(OfProject, Base):
    """One calibration: what was asked for, how far it is, and what it ended with.

    `failures_forgiven`: when its user resumed a study that failures had paused, all designs up to this number.
    `import_hash`: of the file's content, for a study that was calculated elsewhere and only read in.
    """

    __tablename__ = "studies"
    __table_args__ = (
        UniqueConstraint("idempotency_key", "project"),
        UniqueConstraint("import_hash", "project"),
        {"sqlite_autoincrement": True},
    )

    id: Mapped[int] = mapped_column(Id, primary_key=True)
    state: Mapped[StudyState] = mapped_column(stored_enum(StudyState, "state"), default=StudyState.RUNNING)
    material: Mapped[str] = mapped_column(String(64))
    spec: Mapped[dict[str, Any]]
    space_hash: Mapped[str] = mapped_column(String(64))
    seed: Mapped[int]
    budget: Mapped[int]
    feasible: Mapped[int] = mapped_column(default=0)
    unfeasible: Mapped[int] = mapped_column(default=0)
    error: Mapped[int] = mapped_column(default=0)
    stop_reason: Mapped[str | None] = mapped_column(String(32))
    stop_text: Mapped[str | None] = mapped_column(Text)
    stop_numbers: Mapped[dict[str, Any] | None]
    recommendation: Mapped[dict[str, Any] | None]
    pause_reason: Mapped[str | None] = mapped_column(String(32))
    pause_text: Mapped[str | None] = mapped_column(Text)
    pause_numbers: Mapped[dict[str, Any] | None]
    failures_forgiven: Mapped[int] = mapped_column(default=0, server_default="0")
    import_hash: Mapped[str | None] = mapped_column(String(64))
    idempotency_key: Mapped[str | None] = mapped_column(String(200))
    request_hash: Mapped[str | None] = mapped_column(String(64))
    created_at: Mapped[float] = mapped_column(default=database_now())
    ended_at: Mapped[float | None]


class ProposalRow(Base):
    """One answer of the optimizer: for which design it was asked, what it was told, and how it decided.

    `basis`: results of designs up to this number were seen; `pending`: designs in flight beyond it. `chosen` is
    the number of the design that it proposed, None where it ended or paused the study (`stop_reason`).
    """

    __tablename__ = "proposals"
    __table_args__ = (
        UniqueConstraint("study_id", "chosen"),
        Index("ix_proposals_surrogate_id", "surrogate_id"),
        {"sqlite_autoincrement": True},
    )

    id: Mapped[int] = mapped_column(Id, primary_key=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"))
    surrogate_id: Mapped[int | None] = mapped_column(ForeignKey("surrogates.id", ondelete="CASCADE"))
    number: Mapped[int]
    chosen: Mapped[int | None]
    basis: Mapped[int]
    pending: Mapped[int]
    seed: Mapped[int]
    strategy: Mapped[str] = mapped_column(String(32))
    acquisition: Mapped[float | None]
    training_hash: Mapped[str | None] = mapped_column(String(64))
    stop_reason: Mapped[str | None] = mapped_column(String(32))
    created_at: Mapped[float] = mapped_column(default=database_now())


class SurrogateRow(Base):
    """A fitted surrogate as numbers: hyper-parameters with the noise, leave-one-out figures, inflation.

    With the training set (designs up to a proposal's basis) they repeat the fit; nothing is pickled.
    """

    __tablename__ = "surrogates"
    __table_args__ = (UniqueConstraint("study_id", "training_hash"), {"sqlite_autoincrement": True})

    id: Mapped[int] = mapped_column(Id, primary_key=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"))
    training_hash: Mapped[str] = mapped_column(String(64))
    hyperparameters: Mapped[dict[str, Any]]
    created_at: Mapped[float] = mapped_column(default=database_now())


class ReportRow(Base):
    """What was known of a study at one moment: posterior, what is identified, sensitivity, ensemble."""

    __tablename__ = "reports"
    __table_args__ = (Index("ix_reports_study_id_id", "study_id", "id"), {"sqlite_autoincrement": True})

    id: Mapped[int] = mapped_column(Id, primary_key=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"))
    designs: Mapped[int]
    code_version: Mapped[str | None] = mapped_column(String(64))
    content: Mapped[dict[str, Any]]
    created_at: Mapped[float] = mapped_column(default=database_now())


class BudgetChangeRow(Base):
    """A user's change of a study's budget; `number` is the first design that was proposed under it."""

    __tablename__ = "budget_changes"
    __table_args__ = (
        Index("ix_budget_changes_study_id_id", "study_id", "id"),
        {"sqlite_autoincrement": True},
    )

    id: Mapped[int] = mapped_column(Id, primary_key=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"))
    number: Mapped[int]
    before: Mapped[int]
    after: Mapped[int]
    created_at: Mapped[float] = mapped_column(default=database_now())


class DesignRow(Base):
    """One simulated parameter set: why it was proposed, what was predicted for it, and what came out.

    `responses`: what was measured, by observable. `supersedes`: the number of a design that ended in error and
    is repeated here with the same seed; proposals that see this result no longer see that error.
    """

    __tablename__ = "designs"
    __table_args__ = (
        UniqueConstraint("study_id", "number"),
        UniqueConstraint("study_id", "idempotency_key", name="uq_designs_idempotency_key"),
        # The seed is part of a design's key: the same x with another seed is a replicate, with the same seed
        # a mistake. A cancelled design gave nothing, so it may be proposed again, and one that ended in error
        # may be repeated by hand.
        Index(
            "uq_designs_key",
            "study_id",
            "x_hash",
            "scale",
            "seed",
            unique=True,
            sqlite_where=text("state not in ('CANCELLED', 'FAILED')"),
            postgresql_where=text("state not in ('CANCELLED', 'FAILED')"),
        ),
        {"sqlite_autoincrement": True},
    )

    id: Mapped[int] = mapped_column(Id, primary_key=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"))
    number: Mapped[int]
    x: Mapped[dict[str, Any]]
    x_hash: Mapped[str] = mapped_column(String(64))
    scale: Mapped[float]
    seed: Mapped[int]
    origin: Mapped[str] = mapped_column(String(16))
    prediction: Mapped[dict[str, Any] | None]
    acquisition: Mapped[float | None]
    reason: Mapped[str] = mapped_column(Text)
    state: Mapped[DesignState] = mapped_column(stored_enum(DesignState, "state"), default=DesignState.WAITING)
    verdict: Mapped[Verdict | None] = mapped_column(stored_enum(Verdict, "verdict"))
    angle_deg: Mapped[float | None]
    angle_sd_deg: Mapped[float | None]
    literal_angle_deg: Mapped[float | None]
    responses: Mapped[dict[str, Any] | None]
    results: Mapped[dict[str, Any] | None]
    failure_class: Mapped[str | None] = mapped_column(String(32))
    failure_text: Mapped[str | None] = mapped_column(Text)
    supersedes: Mapped[int | None]
    idempotency_key: Mapped[str | None] = mapped_column(String(200))
    created_at: Mapped[float] = mapped_column(default=database_now())
    started_at: Mapped[float | None]
    ended_at: Mapped[float | None]


class JobRow(Base):
    """A piece of work for a worker, of a study, a charge or a diagnosis. This row is the truth; the message in the
    broker only says "look here".

    `attempt` is the fence: a worker may only write where the attempt is still its own. `max_attempts` bounds
    the attempts that were lost; one that was given back in order, repeated by a retry rule, or forgiven (its
    worker was late, not dead) raises it.
    `lease_until` is by `clock.lease_now`. `paused_until`: nobody is told of the queued job until then, for
    `pause_reason` (no room on the disk).
    """

    __tablename__ = "jobs"
    __table_args__ = (
        CheckConstraint("(kind = 'simulate') = (design_id is not null)", name="design"),
        CheckConstraint("(kind = 'charge') = (charge_id is not null)", name="charge"),
        CheckConstraint("(kind = 'diagnose') = (diagnosis_id is not null)", name="diagnosis"),
        CheckConstraint(_one_owner("study_id"), name="owner"),
        Index("ix_jobs_state_published_at", "state", "published_at"),
        Index("ix_jobs_created_at_id", "created_at", "id"),
        Index("ix_jobs_study_id", "study_id"),
        Index("ix_jobs_design_id", "design_id"),
        Index("uq_jobs_charge_id", "charge_id", unique=True),
        Index("uq_jobs_diagnosis_id", "diagnosis_id", unique=True),
        Index(
            "uq_jobs_open_design",
            "design_id",
            unique=True,
            sqlite_where=text("state in ('queued', 'running')"),
            postgresql_where=text("state in ('queued', 'running')"),
        ),
        Index(
            "uq_jobs_open_study",
            "study_id",
            unique=True,
            sqlite_where=text("kind in ('propose', 'recommend') and state in ('queued', 'running')"),
            postgresql_where=text("kind in ('propose', 'recommend') and state in ('queued', 'running')"),
        ),
        Index(
            "uq_jobs_open_report",
            "study_id",
            unique=True,
            sqlite_where=text("kind = 'report' and state in ('queued', 'running')"),
            postgresql_where=text("kind = 'report' and state in ('queued', 'running')"),
        ),
    )

    id: Mapped[str] = mapped_column(String(36), primary_key=True)
    kind: Mapped[JobKind] = mapped_column(stored_enum(JobKind, "kind"))
    study_id: Mapped[int | None] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"))
    design_id: Mapped[int | None] = mapped_column(ForeignKey("designs.id", ondelete="CASCADE"))
    charge_id: Mapped[int | None] = mapped_column(ForeignKey("charges.id", ondelete="CASCADE"))
    diagnosis_id: Mapped[int | None] = mapped_column(ForeignKey("diagnoses.id", ondelete="CASCADE"))
    state: Mapped[JobState] = mapped_column(stored_enum(JobState, "state"), default=JobState.QUEUED)
    attempt: Mapped[int] = mapped_column(default=0)
    max_attempts: Mapped[int]
    time_step_factor: Mapped[float] = mapped_column(default=1.0)
    lease_until: Mapped[float | None]
    worker_id: Mapped[str | None] = mapped_column(String(36))
    published_at: Mapped[float | None]
    publications: Mapped[int] = mapped_column(default=0)
    progress: Mapped[dict[str, Any] | None]
    cancel_requested: Mapped[bool] = mapped_column(default=False)
    checkpoint: Mapped[dict[str, Any] | None]
    failure_text: Mapped[str | None] = mapped_column(Text)
    paused_until: Mapped[float | None]
    pause_reason: Mapped[str | None] = mapped_column(Text)
    created_at: Mapped[float] = mapped_column(default=database_now())
    ended_at: Mapped[float | None]


class RunRow(Base):
    """One attempt at a job, with what it cost and how it ended (`exit_class` None: it still runs)."""

    __tablename__ = "runs"
    __table_args__ = (UniqueConstraint("job_id", "attempt"),)

    id: Mapped[int] = mapped_column(Id, primary_key=True)
    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"))
    attempt: Mapped[int]
    worker_id: Mapped[str] = mapped_column(String(36))
    started_at: Mapped[float] = mapped_column(default=database_now())
    ended_at: Mapped[float | None]
    exit_class: Mapped[str | None] = mapped_column(String(32))
    exit_text: Mapped[str | None] = mapped_column(Text)
    time_step_factor: Mapped[float] = mapped_column(default=1.0)
    code_version: Mapped[str | None] = mapped_column(String(64))
    time_step_s: Mapped[float | None]
    steps: Mapped[int | None]
    wall_s: Mapped[float | None]
    cpu_s: Mapped[float | None]
    memory_mb: Mapped[float | None]


class ArtifactRow(Base):
    """A file of a design, a charge or a diagnosis, fetched by this id; `path` (below the artifact folder) never
    leaves the service."""

    __tablename__ = "artifacts"
    __table_args__ = (
        UniqueConstraint("design_id", "kind"),
        UniqueConstraint("charge_id", "kind"),
        UniqueConstraint("diagnosis_id", "kind"),
        CheckConstraint(_one_owner("design_id"), name="owner"),
        {"sqlite_autoincrement": True},
    )

    id: Mapped[int] = mapped_column(Id, primary_key=True)
    design_id: Mapped[int | None] = mapped_column(ForeignKey("designs.id", ondelete="CASCADE"))
    charge_id: Mapped[int | None] = mapped_column(ForeignKey("charges.id", ondelete="CASCADE"))
    diagnosis_id: Mapped[int | None] = mapped_column(ForeignKey("diagnoses.id", ondelete="CASCADE"))
    kind: Mapped[str] = mapped_column(String(16))
    file_name: Mapped[str] = mapped_column(String(100))
    media_type: Mapped[str] = mapped_column(String(100))
    sha256: Mapped[str] = mapped_column(String(64))
    size_bytes: Mapped[int]
    path: Mapped[str] = mapped_column(String(200))
    created_at: Mapped[float] = mapped_column(default=database_now())


class EventRow(Base):
    """Something that happened to a study. The id only grows within a study: a client's cursor."""

    __tablename__ = "events"
    __table_args__ = (Index("ix_events_study_id_id", "study_id", "id"), {"sqlite_autoincrement": True})

    id: Mapped[int] = mapped_column(Id, primary_key=True)
    study_id: Mapped[int] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"))
    kind: Mapped[str] = mapped_column(String(32))
    data: Mapped[dict[str, Any]]
    created_at: Mapped[float] = mapped_column(default=database_now())


class ProcessRow(Base):
    """A running process of the service (worker or dispatcher): when it was last seen, and what it saw."""

    __tablename__ = "processes"

    id: Mapped[str] = mapped_column(String(36), primary_key=True)
    role: Mapped[str] = mapped_column(String(16))
    host: Mapped[str] = mapped_column(String(200))
    pid: Mapped[int]
    started_at: Mapped[float] = mapped_column(default=database_now())
    seen_at: Mapped[float] = mapped_column(default=database_now())
    problem: Mapped[str | None] = mapped_column(Text)


class ApiKeyRow(Base):
    """A key of the API. Only its hash is kept; `prefix` is the part of it by which it is found and named."""

    __tablename__ = "api_keys"
    __table_args__ = (UniqueConstraint("prefix"), {"sqlite_autoincrement": True})

    id: Mapped[int] = mapped_column(Id, primary_key=True)
    name: Mapped[str] = mapped_column(String(100))
    prefix: Mapped[str] = mapped_column(String(16))
    secret_hash: Mapped[str] = mapped_column(String(64))
    scope: Mapped[Scope] = mapped_column(stored_enum(Scope, "scope"))
    project: Mapped[str] = mapped_column(String(32))
    created_at: Mapped[float] = mapped_column(default=database_now())
    revoked_at: Mapped[float | None]

"""What the API answers: rows as JSON, times as UTC text, files and studies by id."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any, Self

from pydantic import BaseModel, Field

from service.db.models import ArtifactRow, JobRow, RunRow, StudyRow
from service.db.read_models import DesignView
from service.domain.explanation import compare
from service.domain.noise import RunNoise
from service.domain.spec_record import upgraded
from service.domain.states import DesignState, JobKind, JobState, StudyState, Verdict


def as_utc(seconds: float | None) -> datetime | None:
    """Seconds since 1970 as a time with its zone."""
    return None if seconds is None else datetime.fromtimestamp(seconds, UTC)


class Counters(BaseModel):
    """Finished designs by verdict."""

    feasible: int
    unfeasible: int
    error: int


class StopBody(BaseModel):
    """Why a study proposed nothing more, with the numbers that decided."""

    reason: str = Field(examples=["certified"])
    text: str | None
    numbers: dict[str, Any] | None


class NoiseAnswer(BaseModel):
    """How far runs of one design scatter, beside the tolerance of the certificate."""

    observable: str = Field(examples=["angle_deg"])
    unit: str = Field(examples=["deg"])
    tolerance: float
    sd: float | None = Field(description="within designs, pooled; what is expected where not measured")
    freedom: int = Field(description="degrees of freedom of replicates; 0: not measured yet")
    is_measured: bool
    text: str


class StudyAnswer(BaseModel):
    """A study: what was asked for, how far it is, what it ended with."""

    id: int = Field(examples=[1])
    state: StudyState
    material: str = Field(examples=["pellet"])
    spec: dict[str, Any] = Field(description="the study as asked for, with all defaults written out")
    budget: int
    seed: int
    counters: Counters
    stop: StopBody | None
    pause: StopBody | None = Field(description="why it is paused, null when it is not")
    recommendation: dict[str, Any] | None = Field(
        description="the optimum: `x` by parameter, posterior mean_deg and sd_deg, replicates_deg, certified"
    )
    noise: list[NoiseAnswer] | None = Field(description="by response; only where one study is asked for")
    created_at: datetime | None
    ended_at: datetime | None

    @classmethod
    def of(cls, row: StudyRow, noise: Sequence[RunNoise] | None = None) -> Self:
        stop, pause = None, None
        if row.stop_reason is not None:
            stop = StopBody(reason=row.stop_reason, text=row.stop_text, numbers=row.stop_numbers)
        if row.pause_reason is not None:
            pause = StopBody(reason=row.pause_reason, text=row.pause_text, numbers=row.pause_numbers)
        return cls(
            id=row.id,
            state=row.state,
            material=row.material,
            spec=upgraded(row.spec),
            budget=row.budget,
            seed=row.seed,
            counters=Counters(feasible=row.feasible, unfeasible=row.unfeasible, error=row.error),
            stop=stop,
            pause=pause,
            recommendation=row.recommendation,
            noise=noise and [NoiseAnswer.model_validate(one, from_attributes=True) for one in noise],
            created_at=as_utc(row.created_at),
            ended_at=as_utc(row.ended_at),
        )


class ReportAnswer(BaseModel):
    """What is known of a study's parameters: identifiability, sensitivity, which test next, an ensemble."""

    study_id: int
    designs: int = Field(description="with results, when it was written")
    is_current: bool = Field(description="no design has ended since")
    code_version: str | None
    created_at: datetime | None
    report: dict[str, Any]


class EnsembleAnswer(BaseModel):
    """Sets of parameters that are all good: the optimum first, then others as different as can be."""

    study_id: int
    level: float | None = Field(description="least chance to be in the window, of the alternates")
    text: str | None
    members: list[dict[str, Any]] = Field(description="x by parameter, window_probability, predicted")


class StudyList(BaseModel):
    """Studies, newest first."""

    items: list[StudyAnswer]
    next_cursor: int | None = Field(description="pass it as `cursor` for the next page; null: there is none")


class ArtifactAnswer(BaseModel):
    """A file of a design or a charge; its bytes are at `url`."""

    id: int
    kind: str = Field(examples=["vtkhdf", "picture"])
    file_name: str
    media_type: str
    size_bytes: int
    sha256: str
    url: str = Field(examples=["/v1/artifacts/1"])

    @classmethod
    def of(cls, row: ArtifactRow) -> Self:
        return cls(
            id=row.id,
            kind=row.kind,
            file_name=row.file_name,
            media_type=row.media_type,
            size_bytes=row.size_bytes,
            sha256=row.sha256,
            url=f"/v1/artifacts/{row.id}",
        )


class ArtifactList(BaseModel):
    """The files of a design or a charge."""

    items: list[ArtifactAnswer]

    @classmethod
    def of(cls, rows: Sequence[ArtifactRow]) -> Self:
        return cls(items=[ArtifactAnswer.of(row) for row in rows])


class ComparisonAnswer(BaseModel):
    """One response of a design: what was predicted before it ran, and what came out."""

    observable: str = Field(examples=["angle_deg"])
    unit: str = Field(examples=["deg"])
    mean: float
    sd: float = Field(description="of the predicted mean, inflated as the study's certificate is")
    noise_sd: float | None = Field(description="between two runs of one design")
    interval_90: tuple[float, float] = Field(description="holds one run's value with 90 %")
    measured: float | None
    z: float | None = Field(description="(measured - mean) / sqrt(sd^2 + noise_sd^2)")
    inside_90: bool | None


class WhyAnswer(BaseModel):
    """Why this point?"""

    reason: str
    compared: list[ComparisonAnswer] = Field(description="empty where nothing was predicted")
    basis: int | None = Field(description="the proposal saw the results of designs up to this number")

    @classmethod
    def of(cls, view: DesignView) -> Self:
        row, fit = view.design, view.surrogate
        found = compare(row.prediction, fit.hyperparameters if fit else None, row.responses)
        return cls(
            reason=row.reason,
            compared=[ComparisonAnswer.model_validate(one, from_attributes=True) for one in found],
            basis=view.proposal.basis if view.proposal else None,
        )


class DesignAnswer(BaseModel):
    """One simulated parameter set: why it was proposed, what was predicted, what came out."""

    id: int
    study_id: int
    number: int = Field(description="position in the study, from 1 without gaps")
    state: DesignState
    verdict: Verdict | None
    x: dict[str, float] = Field(examples=[{"particle_particle_static_friction": 0.35}])
    scale: float
    seed: int
    origin: str = Field(examples=["doe", "model", "replicate"])
    reason: str
    why: WhyAnswer
    prediction: dict[str, Any] | None
    acquisition: float | None
    training_hash: str | None
    hyperparameters: dict[str, Any] | None
    angle_deg: float | None
    angle_sd_deg: float | None = Field(description="standard error over the sectors of this one pile")
    literal_angle_deg: float | None = Field(description="the paper's literal reading of the same pile")
    responses: dict[str, float] | None = Field(description="what was measured, by observable")
    results: dict[str, Any] | None
    supersedes: int | None = Field(description="the number of the error that this design repeats")
    failure_class: str | None
    failure_text: str | None
    job_id: str | None
    progress: dict[str, Any] | None
    artifacts: list[ArtifactAnswer]
    created_at: datetime | None
    started_at: datetime | None
    ended_at: datetime | None

    @classmethod
    def of(cls, view: DesignView) -> Self:
        row = view.design
        return cls(
            id=row.id,
            study_id=row.study_id,
            number=row.number,
            state=row.state,
            verdict=row.verdict,
            x=row.x,
            scale=row.scale,
            seed=row.seed,
            origin=row.origin,
            reason=row.reason,
            why=WhyAnswer.of(view),
            prediction=row.prediction,
            acquisition=row.acquisition,
            training_hash=view.proposal.training_hash if view.proposal else None,
            hyperparameters=view.surrogate.hyperparameters if view.surrogate else None,
            angle_deg=row.angle_deg,
            angle_sd_deg=row.angle_sd_deg,
            literal_angle_deg=row.literal_angle_deg,
            responses=row.responses,
            results=row.results,
            supersedes=row.supersedes,
            failure_class=row.failure_class,
            failure_text=row.failure_text,
            job_id=view.job.id if view.job else None,
            progress=view.job.progress if view.job and view.job.state is JobState.RUNNING else None,
            artifacts=[ArtifactAnswer.of(artifact) for artifact in view.artifacts],
            created_at=as_utc(row.created_at),
            started_at=as_utc(row.started_at),
            ended_at=as_utc(row.ended_at),
        )


class DesignList(BaseModel):
    """Designs by number."""

    items: list[DesignAnswer]
    next_cursor: int | None


class RunAnswer(BaseModel):
    """One attempt at a job."""

    attempt: int
    worker_id: str
    exit_class: str | None = Field(examples=["done", "lost", "blow_up"])
    exit_text: str | None
    time_step_factor: float
    code_version: str | None
    time_step_s: float | None
    steps: int | None
    wall_s: float | None
    cpu_s: float | None
    memory_mb: float | None
    started_at: datetime | None
    ended_at: datetime | None

    @classmethod
    def of(cls, row: RunRow) -> Self:
        times = {"started_at": as_utc(row.started_at), "ended_at": as_utc(row.ended_at)}
        plain = {name: getattr(row, name) for name in cls.model_fields if name not in times}
        return cls(**plain, **times)


class JobAnswer(BaseModel):
    """A piece of work for a worker. `runs` (its attempts) only where one job is asked for."""

    id: str
    kind: JobKind
    study_id: int | None
    design_id: int | None
    charge_id: int | None
    diagnosis_id: int | None
    state: JobState
    attempt: int
    max_attempts: int
    progress: dict[str, Any] | None
    cancel_requested: bool
    pause_reason: str | None
    failure_text: str | None
    worker_id: str | None
    created_at: datetime | None
    ended_at: datetime | None
    runs: list[RunAnswer] | None = None

    @classmethod
    def of(cls, row: JobRow, runs: Sequence[RunRow] | None = None) -> Self:
        times = {"created_at": as_utc(row.created_at), "ended_at": as_utc(row.ended_at)}
        plain = {name: getattr(row, name) for name in cls.model_fields if name not in (*times, "runs")}
        answers = None if runs is None else [RunAnswer.of(run) for run in runs]
        return cls(**plain, **times, runs=answers)


class JobList(BaseModel):
    """Jobs, newest first."""

    items: list[JobAnswer]
    next_cursor: str | None


class SizeClassAnswer(BaseModel):
    """Diameters from lower to upper hold this share of the mass."""

    lower_m: float
    upper_m: float
    mass_share: float


class WallRestitutionAnswer(BaseModel):
    """The share of the mass that rebounds from steel with this restitution."""

    value: float
    mass_share: float


class MaterialAnswer(BaseModel):
    """A shipped material, with the repose angle that a calibration of it aims at."""

    name: str = Field(examples=["pellet"])
    target_deg: float = Field(examples=[25.5])
    window_deg: tuple[float, float] = Field(examples=[(25.0, 26.0)])
    bulk_density_kg_m3: float
    particle_density_kg_m3: float
    packing_fraction: float
    youngs_modulus_pa: float
    poisson_ratio: float
    long_term_damping: float
    dynamic_friction_ratio: float
    wall_restitution: list[WallRestitutionAnswer]
    sizes: list[SizeClassAnswer]
    constraints: list[str] = Field(
        description="what is published of the sizes, and how these classes meet it"
    )


class MaterialList(BaseModel):
    """The shipped materials."""

    items: list[MaterialAnswer]


class RigAnswer(BaseModel):
    """A pile-test rig: a filled cylinder on a round base; the sectors are of the paper's literal reading."""

    name: str = Field(examples=["pellet"])
    base_diameter_m: float
    cylinder_diameter_m: float
    cylinder_height_m: float
    circular_sectors: int
    radial_sectors: int


class RigList(BaseModel):
    """The shipped rigs; a material's own has its name."""

    items: list[RigAnswer]


class Check(BaseModel):
    """One thing that a working installation needs. `required`: without it this process cannot answer."""

    ok: bool
    required: bool
    reason: str | None = Field(description="what is wrong, null when nothing is")


class Readiness(BaseModel):
    """Whether requests can be answered, and what else is missing for jobs to run."""

    ready: bool
    checks: dict[str, Check]


class Liveness(BaseModel):
    """The process answers."""

    status: str = "alive"

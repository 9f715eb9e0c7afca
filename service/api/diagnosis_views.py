"""What the API takes and answers about measured data sets, diagnoses and versions of the model."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from service.api.study_parts import STRICT, ModelVersion
from service.api.views import ArtifactAnswer, as_utc
from service.db.models import DataSetRow, ModelVersionRow
from service.db.read_diagnoses import DiagnosisView
from service.domain.claims import ClaimCheck, JudgedClaim
from service.domain.diagnosis import DiagnosisSpec, PlanSpec
from service.domain.model_use import ModelUse
from service.domain.plain_text import clean_text
from service.domain.states import DesignState, JobState

_DEFAULT = DiagnosisSpec(1)
_PLAN = PlanSpec()


class DataSetBody(BaseModel):
    """A measured data set: its tables as texts of CSV files."""

    model_config = ConfigDict(**STRICT)

    name: Annotated[str, Field(min_length=1, max_length=100), AfterValidator(clean_text)]
    tables: Annotated[
        dict[str, str],
        Field(
            description="texts by file name: conditions.csv, observations.csv and perhaps profiles.csv",
            examples=[
                {"conditions.csv": "condition,test,...", "observations.csv": "condition,replicate,..."}
            ],
        ),
    ]
    planned: Annotated[
        bool, Field(description="the tests lie ahead: conditions.csv alone is enough, and only for a plan")
    ] = False


class ConditionFacts(BaseModel):
    """One condition of a data set."""

    condition: str
    test: str
    material: str
    holdout: bool
    replicates: int


class DataSetAnswer(BaseModel):
    """A stored data set, and what it is too thin for."""

    id: int
    name: str
    split_hash: str = Field(description="SHA-256 of the values and of which conditions are held out")
    conditions: list[ConditionFacts]
    observations: int
    profiles: int
    can_be_diagnosed: bool
    sentences: list[str] = Field(description="what cannot be concluded from it, and why")
    opened_by: int | None = Field(description="the diagnosis that has looked at the held-out conditions")
    created_at: datetime | None

    @classmethod
    def of(cls, row: DataSetRow) -> Self:
        return cls(
            id=row.id,
            name=row.name,
            split_hash=row.split_hash,
            opened_by=row.opened_by,
            created_at=as_utc(row.created_at),
            **row.facts,
        )


class DataSetList(BaseModel):
    """Data sets, newest first."""

    items: list[DataSetAnswer]
    next_cursor: int | None = Field(description="pass it as `cursor` for the next page; null: there is none")


class PlanBody(BaseModel):
    """What the tests could show, instead of what is wrong. `{}` is enough."""

    model_config = ConfigDict(**STRICT)

    replicates: Annotated[int, Field(description="of each condition")] = _PLAN.replicates
    observables: Annotated[
        list[str], Field(description="that would be read, and `profiles` for whole surfaces; none: all")
    ] = []
    candidates: Annotated[
        list[str], Field(description="conditions that are not decided: the best single one is sought")
    ] = []

    def to_spec(self) -> PlanSpec:
        """What the domain is asked. Raises InvalidValue."""
        return PlanSpec(self.replicates, tuple(self.observables), tuple(self.candidates))


class DiagnosisBody(BaseModel):
    """A diagnosis of a data set. `{"data_set": 1}` is enough."""

    model_config = ConfigDict(**STRICT)

    data_set: int
    grains: Annotated[int, Field(description="about which a simulated pile is made of")] = _DEFAULT.grains
    contact_model: str = _DEFAULT.contact_model
    first_wave: Annotated[int, Field(description="runs of each condition over the whole box")] = (
        _DEFAULT.first_wave
    )
    second_wave: Annotated[int, Field(description="and about the re-calibrated parameters")] = (
        _DEFAULT.second_wave
    )
    plants: Annotated[int, Field(description="effect-free pseudo-plants")] = _DEFAULT.plants
    seed: int = _DEFAULT.seed
    model_version: ModelVersion = None
    plan: PlanBody | None = None

    def to_spec(self) -> DiagnosisSpec:
        """What the domain is asked. Raises InvalidValue."""
        plan = None if self.plan is None else self.plan.to_spec()
        model = ModelUse.asked(self.model_version, 0.0)
        return DiagnosisSpec(**self.model_dump(exclude={"plan", "model_version"}), plan=plan, model=model)


class DiagnosisCostBody(BaseModel):
    """What a diagnosis was expected to take when it was asked for."""

    runs: int
    hours: float = Field(description="of one core")
    text: str


class ClaimCheckBody(BaseModel):
    """What the check of a claim showed. Checks are appended; the last one counts."""

    model_config = ConfigDict(**STRICT)

    state: Annotated[str, Field(description="confirmed or withdrawn", examples=["confirmed"])]
    note: Annotated[str, Field(description="what was seen"), AfterValidator(clean_text)] = ""

    def to_check(self) -> ClaimCheck:
        """What the domain is told. Raises InvalidValue."""
        return ClaimCheck.asked(self.state, self.note)


class ClaimCheckAnswer(BaseModel):
    """One check of a claim."""

    state: str
    note: str
    at: datetime | None


class ClaimAnswer(BaseModel):
    """A claim and what became of it."""

    effect: str
    state: str = Field(description="proposed, confirmed or withdrawn: by the last of its checks")
    level: str = Field(description="named, claim (gains on held-out data), strong claim (and is confirmed)")
    checks: list[ClaimCheckAnswer] = Field(description="the oldest first")

    @classmethod
    def of(cls, claim: JudgedClaim) -> Self:
        checks = [ClaimCheckAnswer(state=c.outcome.value, note=c.note, at=as_utc(c.at)) for c in claim.checks]
        return cls(effect=claim.effect, state=claim.state, level=claim.level, checks=checks)


class DiagnosisAnswer(BaseModel):
    """One diagnosis: what was asked for, how far it is, what it says."""

    id: int
    data_set: int
    state: DesignState
    spec: dict[str, Any]
    cost: DiagnosisCostBody
    verdict: str | None
    result: dict[str, Any] | None = Field(
        description="verdict, claims, also_possible, not_testable, indistinguishable, unexplained, remainder,"
        " gain, next_measurement, cost, model_version; with limits, sentences, self_tests, the"
        " extended model's name, and `baseline`: the calibrated parameters by material and name (value and 90 %"
        " interval without any effect, and averaged over the models), with their covariance in units of the"
        " search box. Of a plan: verdict, effects, adds, sentences, cost, model_version"
    )
    claims: list[ClaimAnswer] = Field(description="what became of the claims of the result")
    failure_class: str | None
    failure_text: str | None
    job_id: str | None
    progress: dict[str, Any] | None
    artifacts: list[ArtifactAnswer]
    created_at: datetime | None
    started_at: datetime | None
    ended_at: datetime | None

    @classmethod
    def of(cls, view: DiagnosisView) -> Self:
        row, job = view.diagnosis, view.job
        return cls(
            id=row.id,
            data_set=row.data_set_id,
            state=row.state,
            spec=row.spec,
            cost=DiagnosisCostBody(**row.cost),
            verdict=row.verdict,
            result=view.results,
            claims=[ClaimAnswer.of(claim) for claim in view.claims],
            failure_class=row.failure_class,
            failure_text=row.failure_text,
            job_id=job.id if job else None,
            progress=job.progress if job and job.state is JobState.RUNNING else None,
            artifacts=[ArtifactAnswer.of(artifact) for artifact in view.artifacts],
            created_at=as_utc(row.created_at),
            started_at=as_utc(row.started_at),
            ended_at=as_utc(row.ended_at),
        )


class DiagnosisList(BaseModel):
    """Diagnoses, newest first."""

    items: list[DiagnosisAnswer]
    next_cursor: int | None = Field(description="pass it as `cursor` for the next page; null: there is none")


class ModelVersionAnswer(BaseModel):
    """The model extended with named effects."""

    id: int
    name: str
    parent: int | None = Field(description="the version that it extends; null: the baseline")
    diagnosis: int
    base: str = Field(description="the simulator that it extends, with its code")
    effects: dict[str, Any] = Field(
        description="by effect: value, unit and 90 % interval of the amplitude; its parent's are among them"
    )
    parameters: dict[str, Any] | None = Field(
        description="the contact parameters calibrated beside the effects: value and 90 % interval by material"
        " and name, and the covariance of both; null in versions made before they were kept"
    )
    withdrawn_at: datetime | None
    created_at: datetime | None

    @classmethod
    def of(cls, row: ModelVersionRow) -> Self:
        return cls(
            id=row.id,
            name=row.name,
            parent=row.parent_id,
            diagnosis=row.diagnosis_id,
            base=row.base,
            effects=row.effects,
            parameters=row.parameters,
            withdrawn_at=as_utc(row.withdrawn_at),
            created_at=as_utc(row.created_at),
        )


class ModelVersionList(BaseModel):
    """Versions, newest first."""

    items: list[ModelVersionAnswer]
    next_cursor: int | None = Field(description="pass it as `cursor` for the next page; null: there is none")

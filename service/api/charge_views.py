"""What the API answers about charges."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any, Self

from pydantic import BaseModel, Field

from service.api.views import ArtifactAnswer, as_utc
from service.db.read_charges import ChargeView
from service.domain.states import DesignState, JobState


class CostBody(BaseModel):
    """What a charge was expected to take when it was asked for."""

    particles: int
    steps: int
    particle_steps: float
    seconds: float = Field(description="of wall clock on one worker")
    text: str = Field(description="the same as a sentence; it says so where that is days")


class ChargeAnswer(BaseModel):
    """One charge: what was asked for, how far it is, what it found."""

    id: int
    series: int = Field(description="the first charge of the same request")
    state: DesignState
    charge: str
    scale: float
    seed: int
    parameters_from: str = Field(examples=["paper, Table 5"])
    spec: dict[str, Any]
    cost: CostBody
    findings: dict[str, Any] | None = Field(description="the paper's four findings as numbers")
    failure_class: str | None
    failure_text: str | None
    job_id: str | None
    progress: dict[str, Any] | None
    artifacts: list[ArtifactAnswer]
    created_at: datetime | None
    started_at: datetime | None
    ended_at: datetime | None

    @classmethod
    def of(cls, view: ChargeView) -> Self:
        row, job = view.charge, view.job
        return cls(
            id=row.id,
            series=row.series,
            state=row.state,
            charge=row.charge,
            scale=row.scale,
            seed=row.seed,
            parameters_from=row.spec["parameters_from"],
            spec=row.spec,
            cost=CostBody(**row.cost),
            findings=(row.results or {}).get("findings"),
            failure_class=row.failure_class,
            failure_text=row.failure_text,
            job_id=job.id if job else None,
            progress=job.progress if job and job.state is JobState.RUNNING else None,
            artifacts=[ArtifactAnswer.of(artifact) for artifact in view.artifacts],
            created_at=as_utc(row.created_at),
            started_at=as_utc(row.started_at),
            ended_at=as_utc(row.ended_at),
        )


class ChargeList(BaseModel):
    """Charges, newest first."""

    items: list[ChargeAnswer]
    next_cursor: int | None = Field(description="pass it as `cursor` for the next page; null: there is none")


class ChargesAnswer(BaseModel):
    """The charges of one request, with what all of them take."""

    series: int
    items: list[ChargeAnswer]
    seconds: float = Field(description="of all, on one worker")

    @classmethod
    def of(cls, views: Sequence[ChargeView]) -> Self:
        return cls(
            series=views[0].charge.series,
            items=[ChargeAnswer.of(view) for view in views],
            seconds=sum(view.charge.cost["seconds"] for view in views),
        )


class ChargeSummary(BaseModel):
    """Every number of a finished charge."""

    id: int
    summary: dict[str, Any]

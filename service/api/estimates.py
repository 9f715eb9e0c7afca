"""What work would take, asked before it starts: the same body as starts it, the same refusals, nothing stored."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from fastapi import APIRouter
from pydantic import BaseModel, Field
from sqlalchemy.orm import Session

from service.api.charge_body import ChargeBody
from service.api.dependencies import DatabaseDep, GeometriesDep
from service.api.diagnosis_views import DiagnosisBody
from service.api.problems import problem_responses
from service.api.study_body import StudyBody
from service.db.session import Database
from service.studies.create_charges import create_charges
from service.studies.create_diagnosis import create_diagnosis
from service.studies.create_study import create_study
from service.studies.estimate_study import expected_study_cost

router = APIRouter(prefix="/v1", tags=["estimates"])


class EstimateAnswer(BaseModel):
    """What a request would take."""

    runs: int = Field(description="simulations, at most")
    seconds: float | None = Field(description="of all, on one worker; null: nothing like it has run here")
    text: str


@contextmanager
def _trial(database: Database) -> Iterator[Session]:
    """What is written within is taken back: so the refusals are those of the real request, whole."""
    with database.writing() as session:
        savepoint = session.begin_nested()
        try:
            yield session
        finally:
            if savepoint.is_active:
                savepoint.rollback()


@router.post("/studies/estimate", operation_id="estimateStudy", responses=problem_responses(422))
def post_study_estimate(body: StudyBody, database: DatabaseDep) -> EstimateAnswer:
    """What this study would take; refused as the study itself would be."""
    spec = body.to_spec()
    with _trial(database) as session:
        create_study(session, spec)
        cost = expected_study_cost(session, spec)
    return EstimateAnswer(runs=cost.simulations, seconds=cost.seconds, text=cost.text)


@router.post("/charges/estimate", operation_id="estimateCharges", responses=problem_responses(422))
def post_charge_estimate(
    body: ChargeBody, database: DatabaseDep, geometries: GeometriesDep
) -> EstimateAnswer:
    """What these charges would take; refused as they themselves would be."""
    request = body.to_request()
    with _trial(database) as session:
        costs = [row.cost for row in create_charges(session, request, geometries.local)[0]]
    text = costs[0]["text"] if len(costs) == 1 else f"{len(costs)} charges, each: {costs[0]['text']}"
    return EstimateAnswer(runs=len(costs), seconds=sum(cost["seconds"] for cost in costs), text=text)


@router.post("/diagnoses/estimate", operation_id="estimateDiagnosis", responses=problem_responses(422))
def post_diagnosis_estimate(body: DiagnosisBody, database: DatabaseDep) -> EstimateAnswer:
    """What this diagnosis would take; refused as it itself would be."""
    spec = body.to_spec()
    with _trial(database) as session:
        cost = create_diagnosis(session, spec)[0].cost
    return EstimateAnswer(runs=cost["runs"], seconds=3600.0 * cost["hours"], text=cost["text"])

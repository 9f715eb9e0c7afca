"""What work would take, asked before it starts: the same body as starts it, the same refusals, nothing stored.

Only reads: a form asks at every pause of its user's typing, and the check of a charge may take seconds, for which
an SQLite database would take no other writer.
"""

from __future__ import annotations

from fastapi import APIRouter
from pydantic import BaseModel, Field

from service.api.charge_body import ChargeBody
from service.api.dependencies import DatabaseDep, GeometriesDep
from service.api.diagnosis_views import DiagnosisBody
from service.api.problems import problem_responses
from service.api.study_body import StudyBody
from service.studies.check_charges import check_charges
from service.studies.create_diagnosis import check_diagnosis
from service.studies.create_study import check_study
from service.studies.estimate_study import expected_study_cost

router = APIRouter(prefix="/v1", tags=["estimates"])


class EstimateAnswer(BaseModel):
    """What a request would take."""

    runs: int = Field(description="simulations, at most")
    seconds: float | None = Field(description="of all, on one worker; null: nothing like it has run here")
    text: str


@router.post("/studies/estimate", operation_id="estimateStudy", responses=problem_responses(422))
def post_study_estimate(body: StudyBody, database: DatabaseDep) -> EstimateAnswer:
    """What this study would take; refused as the study itself would be."""
    spec = body.to_spec()
    with database.reading() as session:
        check_study(session, spec)
        cost = expected_study_cost(session, spec)
    return EstimateAnswer(runs=cost.simulations, seconds=cost.seconds, text=cost.text)


@router.post("/charges/estimate", operation_id="estimateCharges", responses=problem_responses(422))
def post_charge_estimate(
    body: ChargeBody, database: DatabaseDep, geometries: GeometriesDep
) -> EstimateAnswer:
    """What these charges would take; refused as they themselves would be."""
    request = body.to_request()
    with database.reading() as session:
        costs = [one.cost for one in check_charges(session, request, geometries.local)]
    text = costs[0]["text"] if len(costs) == 1 else f"{len(costs)} charges, each: {costs[0]['text']}"
    return EstimateAnswer(runs=len(costs), seconds=sum(cost["seconds"] for cost in costs), text=text)


@router.post("/diagnoses/estimate", operation_id="estimateDiagnosis", responses=problem_responses(422))
def post_diagnosis_estimate(body: DiagnosisBody, database: DatabaseDep) -> EstimateAnswer:
    """What this diagnosis would take; refused as it itself would be."""
    spec = body.to_spec()
    with database.reading() as session:
        _, cost = check_diagnosis(session, spec)
    return EstimateAnswer(runs=cost.runs, seconds=3600.0 * cost.hours, text=cost.sentence())

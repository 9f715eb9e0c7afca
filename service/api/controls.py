"""What a user does to a study while it runs: pause, resume, cancel, extend, add a design, run one again."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy.orm import Session

from service.api.dependencies import DatabaseDep, RowId
from service.api.problems import problem_responses
from service.api.studies import IdempotencyKey, no_study
from service.api.views import DesignAnswer, StudyAnswer
from service.db import read_models
from service.db.models import DesignRow, StudyRow
from service.errors import NotFound
from service.studies.add_design import add_design, rerun_design
from service.studies.cancel_study import cancel_study
from service.studies.extend_budget import extend_budget
from service.studies.pause_study import pause_study
from service.studies.read_noise import read_noise
from service.studies.resume_study import resume_study

router = APIRouter(prefix="/v1", tags=["controls"])

_STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class BudgetBody(BaseModel):
    """The new budget."""

    model_config = _STRICT

    budget: Annotated[int, Field(description="simulations at most, more than now", examples=[40])]


class NewDesignBody(BaseModel):
    """A design to run: a value for each of the study's variables."""

    model_config = _STRICT

    x: Annotated[dict[str, float], Field(examples=[{"rolling_resistance": 0.2}])]
    seed: Annotated[int | None, Field(description="default: one that no run of these parameters has")] = None


class RerunBody(BaseModel):
    """How to run a design again."""

    model_config = _STRICT

    same_seed: Annotated[
        bool, Field(description="true: repeat a design that ended in error; false: another seed, a replicate")
    ] = False


def _answer(session: Session, study: StudyRow | None, study_id: int) -> StudyAnswer:
    if study is None:
        raise no_study(study_id)
    return StudyAnswer.of(study, read_noise(session, study))


def _created(session: Session, design: DesignRow) -> DesignAnswer:
    session.flush()
    view = read_models.open_design(session, design.id)
    assert view is not None
    return DesignAnswer.of(view)


@router.post(
    "/studies/{study_id}/cancel",
    status_code=202,
    operation_id="cancelStudy",
    responses=problem_responses(404, 409, 422),
)
def post_cancel(study_id: RowId, database: DatabaseDep) -> StudyAnswer:
    """Stop a study. What is in flight is stopped; what is measured stays, with a recommendation from it."""
    with database.writing() as session:
        return _answer(session, cancel_study(session, study_id), study_id)


@router.post(
    "/studies/{study_id}/pause",
    status_code=202,
    operation_id="pauseStudy",
    responses=problem_responses(404, 409, 422),
)
def post_pause(study_id: RowId, database: DatabaseDep) -> StudyAnswer:
    """Propose and start nothing more until it is resumed. Simulations that run come to their end."""
    with database.writing() as session:
        return _answer(session, pause_study(session, study_id), study_id)


@router.post(
    "/studies/{study_id}/resume",
    status_code=202,
    operation_id="resumeStudy",
    responses=problem_responses(404, 409, 422),
)
def post_resume(study_id: RowId, database: DatabaseDep) -> StudyAnswer:
    """Go on. Failures that have paused the study are forgiven; only later ones can pause it again."""
    with database.writing() as session:
        return _answer(session, resume_study(session, study_id), study_id)


@router.post(
    "/studies/{study_id}/budget",
    status_code=202,
    operation_id="extendBudget",
    responses=problem_responses(404, 409, 422),
)
def post_budget(study_id: RowId, body: BudgetBody, database: DatabaseDep) -> StudyAnswer:
    """Give a study that is not over more simulations. The same budget again changes nothing."""
    with database.writing() as session:
        return _answer(session, extend_budget(session, study_id, body.budget), study_id)


@router.post(
    "/studies/{study_id}/designs",
    status_code=201,
    operation_id="addDesign",
    responses=problem_responses(404, 409, 422),
)
def post_design(
    study_id: RowId, body: NewDesignBody, database: DatabaseDep, idempotency_key: IdempotencyKey = None
) -> DesignAnswer:
    """Simulate a design of one's own. It takes the study's next number and counts against its budget."""
    with database.writing() as session:
        design = add_design(session, study_id, body.x, body.seed, idempotency_key)
        if design is None:
            raise no_study(study_id)
        return _created(session, design)


@router.post(
    "/designs/{design_id}/rerun",
    status_code=201,
    operation_id="rerunDesign",
    responses=problem_responses(404, 409, 422),
)
def post_rerun(
    design_id: RowId, body: RerunBody, database: DatabaseDep, idempotency_key: IdempotencyKey = None
) -> DesignAnswer:
    """Run a design again as a new one: with another seed, or after an error with the same."""
    with database.writing() as session:
        design = rerun_design(session, design_id, body.same_seed, idempotency_key)
        if design is None:
            raise NotFound(f"There is no design {design_id}.")
        return _created(session, design)

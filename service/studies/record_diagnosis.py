"""Record a finished diagnosis in one transaction: what it says, extended model, null calibration, files."""

from __future__ import annotations

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from service.db.models import DiagnosisRow, ModelVersionRow, NullCalibrationRow
from service.db.queries import Lease
from service.domain.diagnosis import DiagnosisOutcome, Extension
from service.domain.extended_model import extended
from service.domain.outcome import RunCost
from service.domain.states import DesignState, JobState
from service.studies.close_run import close_run
from service.studies.finish_job import finish_job
from service.studies.keep_files import keep_files
from service.studies.move_task import move_task

BASELINE = "baseline"
# Of a name, which takes 100 characters, with room for a number.
LONGEST_STEM = 90


def record_diagnosis(
    session: Session, lease: Lease, outcome: DiagnosisOutcome, cost: RunCost | None = None
) -> bool:
    """False: the lease was lost, nothing is written."""
    ended = finish_job(session, lease, JobState.DONE)
    if ended is None or not isinstance(ended.owner, DiagnosisRow):
        return False
    diagnosis = ended.owner
    diagnosis.verdict = outcome.verdict
    diagnosis.code_version = cost.code_version if cost is not None else None
    results = dict(outcome.results)
    if outcome.extension is not None:
        results["extended_model"] = _extend(session, diagnosis, outcome.extension).name
    diagnosis.results = results
    if outcome.calibration is not None:
        key, content = outcome.calibration
        if session.get(NullCalibrationRow, key) is None:
            session.add(NullCalibrationRow(key=key, content=dict(content)))
    keep_files(session, outcome.artifacts, diagnosis_id=diagnosis.id)
    move_task(session, diagnosis, DesignState.COMPLETE)
    close_run(session, lease, "done", cost=cost)
    return True


def _extend(session: Session, diagnosis: DiagnosisRow, extension: Extension) -> ModelVersionRow:
    """Named after its parent and its effects, with a number where the name is taken."""
    parent = _parent(session, diagnosis)
    effects = {name: dict(effect) for name, effect in extension.effects.items()}
    stem = "+".join([BASELINE if parent is None else parent.name, *effects])[:LONGEST_STEM]
    taken = session.scalar(
        select(func.count()).where(
            ModelVersionRow.project == diagnosis.project,
            (ModelVersionRow.name == stem) | ModelVersionRow.name.startswith(f"{stem}-", autoescape=True),
        )
    )
    row = ModelVersionRow(
        name=stem if not taken else f"{stem}-{taken + 1}",
        project=diagnosis.project,
        parent_id=None if parent is None else parent.id,
        diagnosis_id=diagnosis.id,
        base=extension.base,
        effects=effects if parent is None else extended(parent.effects, effects),
        parameters=None if extension.parameters is None else dict(extension.parameters),
    )
    session.add(row)
    session.flush()
    return row


def _parent(session: Session, diagnosis: DiagnosisRow) -> ModelVersionRow | None:
    """The version that was diagnosed, also where it was withdrawn meanwhile; None for the baseline."""
    model = diagnosis.spec.get("model")
    if model is None:
        return None
    return session.scalars(
        select(ModelVersionRow).where(
            ModelVersionRow.project == diagnosis.project, ModelVersionRow.name == model["name"]
        )
    ).one()

"""Store a diagnosis that was asked for, with its job."""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from dataclasses import asdict

from sqlalchemy import select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.db.models import DataSetRow, DiagnosisRow, JobRow
from service.domain.data_set.columns import OBSERVABLES_OF, SURFACES
from service.domain.data_set.records import Condition
from service.domain.data_set.stored import from_record
from service.domain.diagnosis import DiagnosisCost, DiagnosisSpec, PlanSpec, expected_cost
from service.domain.errors import InvalidValue
from service.domain.measured_pile import cannot_simulate
from service.domain.model_use import FIELD
from service.domain.states import JobKind
from service.studies.advance_study import ATTEMPTS
from service.studies.create_study import KeyReused
from service.studies.use_model import use_model_in_diagnosis


def check_diagnosis(session: Session, spec: DiagnosisSpec) -> tuple[DiagnosisSpec, DiagnosisCost]:
    """The diagnosis as it would be stored, with its version of the model looked up, and what it would take. Reads
    only.

    Raises InvalidValue for a data set that is not there, too thin to say anything, or with a condition that the
    model cannot represent, for a plan whose candidates are none of its conditions or all of them, or that reads
    nothing of one, and for a version of the model that does not fit.
    """
    data_set = session.get(DataSetRow, spec.data_set)
    if data_set is None:
        raise InvalidValue("data_set", spec.data_set, "the id of an uploaded data set")
    if spec.plan is None and not data_set.facts["can_be_diagnosed"]:
        raise InvalidValue("data_set", spec.data_set, " ".join(data_set.facts["sentences"]))
    conditions = from_record(data_set.content).conditions
    if spec.plan is not None:
        _check_plan(spec.plan, conditions)
    for condition in conditions:
        if (why := cannot_simulate(condition, spec.grains, spec.contact_model)) is not None:
            allowed = f"conditions that the model can represent: {why}"
            raise InvalidValue(f"data_set.{condition.condition}", condition.material, allowed)
    spec = use_model_in_diagnosis(session, spec, conditions)
    if spec.model is not None:
        for condition in conditions:
            why = cannot_simulate(condition, spec.grains, spec.contact_model, spec.model.effects)
            if why is not None:
                allowed = f"one that condition {condition.condition} can have: {why}"
                raise InvalidValue(FIELD, spec.model.name, allowed)
    return spec, expected_cost(spec, conditions)


def create_diagnosis(
    session: Session, spec: DiagnosisSpec, idempotency_key: str | None = None
) -> tuple[DiagnosisRow, bool]:
    """The row, and whether it is new: the same key and request give the stored one again.

    Raises as check_diagnosis, and KeyReused.
    """
    stored = _stored(session, idempotency_key, spec)
    if stored is not None:
        return stored, False
    checked, cost = check_diagnosis(session, spec)
    row = DiagnosisRow(
        data_set_id=spec.data_set,
        spec=checked.as_record(),
        cost={**asdict(cost), "text": cost.sentence()},
        idempotency_key=idempotency_key,
        request_hash=spec.request_hash,
    )
    try:
        with session.begin_nested():
            session.add(row)
            session.flush()
    except IntegrityError:
        stored = _stored(session, idempotency_key, spec)
        if stored is None:
            raise
        return stored, False
    session.add(
        JobRow(id=str(uuid.uuid4()), kind=JobKind.DIAGNOSE, diagnosis_id=row.id, max_attempts=ATTEMPTS)
    )
    session.flush()
    return row, True


def _check_plan(plan: PlanSpec, conditions: Sequence[Condition]) -> None:
    names = [c.condition for c in conditions]
    for name in plan.candidates:
        if name not in names:
            allowed = "conditions of the data set: " + ", ".join(names)
            raise InvalidValue("plan.candidates", name, allowed)
    if len(plan.candidates) == len(names):
        allowed = "not every condition: something must be planned without them"
        raise InvalidValue("plan.candidates", list(plan.candidates), allowed)
    for c in conditions:
        readable = [*OBSERVABLES_OF[c.test], *([SURFACES] if c.test == "pile" else [])]
        if plan.observables and not set(plan.observables).intersection(readable):
            allowed = f"at least one that condition {c.condition} gives: " + ", ".join(readable)
            raise InvalidValue("plan.observables", list(plan.observables), allowed)


def _stored(session: Session, idempotency_key: str | None, spec: DiagnosisSpec) -> DiagnosisRow | None:
    """The diagnosis of an earlier request with this key; none without one."""
    if idempotency_key is None:
        return None
    found = select(DiagnosisRow).where(DiagnosisRow.idempotency_key == idempotency_key)
    row = session.scalars(found).one_or_none()
    if row is not None and row.request_hash != spec.request_hash:
        raise KeyReused(f"belongs to diagnosis {row.id}, which was asked for otherwise")
    return row

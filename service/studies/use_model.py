"""Look up the model version that a study, charge or diagnosis names, and take its effects into what is asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.models import DataSetRow, DiagnosisRow, ModelVersionRow
from service.domain.charge import ChargeSpec, MeshFile, charge_test
from service.domain.data_set.records import Condition
from service.domain.data_set.stored import from_record
from service.domain.diagnosis import DiagnosisSpec
from service.domain.errors import InvalidValue
from service.domain.extended_model import amplitudes_of
from service.domain.measured_pile import pile_scale
from service.domain.model_fit import FoundOn, fitted, fitted_charge, fitted_diagnosis
from service.domain.model_use import FIELD
from service.domain.study import StudySpec


def use_model(session: Session, spec: StudySpec) -> StudySpec:
    """The study with the amplitudes of its version; the same where it names none.

    Raises InvalidValue for a name that no version has, one that was withdrawn, and one that does not fit.
    """
    if spec.model is None:
        return spec
    found = _find(session, spec.model.name)
    return replace(spec, model=fitted(spec.model, found, spec.material, spec.scale, spec.fill_level))


def use_model_in_charge(session: Session, spec: ChargeSpec, mesh_file: MeshFile) -> ChargeSpec:
    """The same for a charge; `mesh_file` gives uploaded meshes."""
    if spec.model is None:
        return spec
    found = _find(session, spec.model.name)
    plain = charge_test(replace(spec, model=None), mesh_file)
    return replace(spec, model=fitted_charge(spec.model, found, plain))


def use_model_in_diagnosis(
    session: Session, spec: DiagnosisSpec, conditions: Sequence[Condition]
) -> DiagnosisSpec:
    """The same for a diagnosis of these conditions."""
    if spec.model is None:
        return spec
    found = _find(session, spec.model.name)
    fits = fitted_diagnosis(spec.model, found, conditions, spec.grains, spec.contact_model)
    return replace(spec, model=fits)


def _find(session: Session, name: str) -> FoundOn:
    row = session.scalars(select(ModelVersionRow).where(ModelVersionRow.name == name)).one_or_none()
    if row is None:
        raise InvalidValue(FIELD, name, "the name of a model version (GET /v1/model-versions)")
    if row.withdrawn_at is not None:
        when = datetime.fromtimestamp(row.withdrawn_at, UTC).date().isoformat()
        raise InvalidValue(FIELD, name, f"a version that still holds: this one was withdrawn on {when}")
    return _found_on(session, row)


def _found_on(session: Session, row: ModelVersionRow) -> FoundOn:
    diagnosis = session.get_one(DiagnosisRow, row.diagnosis_id)
    data = from_record(session.get_one(DataSetRow, diagnosis.data_set_id).content)
    grains = diagnosis.spec["grains"]
    scales = [pile_scale(c, grains) for c in data.training.conditions if c.test == "pile"]
    return FoundOn(
        frozenset(c.material for c in data.training.conditions),
        diagnosis.spec["contact_model"],
        (min(scales), max(scales)),
        {name: float(effect["value"]) for name, effect in row.effects.items()},
        {name: amplitudes_of(name, effect) for name, effect in row.effects.items()},
    )

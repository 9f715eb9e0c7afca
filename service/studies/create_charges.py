"""Store charges that were asked for, one for every seed and set of contact numbers, with a job each."""

from __future__ import annotations

import uuid
from dataclasses import replace
from typing import Any

from sqlalchemy import select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from demcore.experiments.charge_cost import charge_cost
from service.db.models import ChargeRow, GeometryRow, JobRow
from service.domain.charge import ChargeRequest, ChargeSpec, MeshFile, PartMesh, charge_test, request_hash
from service.domain.errors import InvalidValue
from service.domain.states import JobKind
from service.studies.advance_study import ATTEMPTS
from service.studies.charge_rate import expected_rate
from service.studies.create_study import KeyReused
from service.studies.resolve_sets import resolve_sets
from service.studies.use_model import use_model_in_charge


def create_charges(
    session: Session, request: ChargeRequest, mesh_file: MeshFile, idempotency_key: str | None = None
) -> tuple[list[ChargeRow], bool]:
    """The rows, and whether they are new: the same key and request give the stored ones again. `mesh_file`
    gives uploaded meshes.

    Raises InvalidValue for a plant that cannot be charged, a mass that does not fit, numbers that the contact
    model does not take, a study, a geometry or a model version that is not there or does not fit; KeyReused.
    """
    specs = _specs(session, request, mesh_file)
    wanted = request_hash(specs)
    stored = _stored(session, idempotency_key, wanted)
    if stored:
        return stored, False
    costs = [_cost(session, spec, mesh_file) for spec in specs]
    rows = [
        ChargeRow(
            series=0,
            charge=spec.charge,
            scale=spec.scale,
            seed=spec.seed,
            spec=spec.as_record(),
            cost=cost,
            idempotency_key=idempotency_key if k == 0 else None,
            request_hash=wanted,
        )
        for k, (spec, cost) in enumerate(zip(specs, costs, strict=True))
    ]
    try:
        # A savepoint: where another request with the same key was faster, only this insert is undone.
        with session.begin_nested():
            session.add_all(rows[:1])
            session.flush()
    except IntegrityError:
        if idempotency_key is None:
            raise
        return _stored(session, idempotency_key, wanted), False
    session.add_all(rows)
    for row in rows:
        row.series = rows[0].id
    session.flush()
    for row in rows:
        session.add(
            JobRow(id=str(uuid.uuid4()), kind=JobKind.CHARGE, charge_id=row.id, max_attempts=ATTEMPTS)
        )
    session.flush()
    return rows, True


def _stored(session: Session, idempotency_key: str | None, wanted: str) -> list[ChargeRow]:
    """The charges of an earlier request with this key; none without one."""
    if idempotency_key is None:
        return []
    found = select(ChargeRow).where(ChargeRow.idempotency_key == idempotency_key)
    first = session.scalars(found).one_or_none()
    if first is None:
        return []
    if first.request_hash != wanted:
        raise KeyReused(f"belongs to charge {first.id}, which was asked for otherwise")
    series = select(ChargeRow).where(ChargeRow.series == first.series).order_by(ChargeRow.id)
    return list(session.scalars(series))


def _specs(session: Session, request: ChargeRequest, mesh_file: MeshFile) -> list[ChargeSpec]:
    spec = replace(request.spec, meshes=_meshes(session, request))
    sets = resolve_sets(session, spec.charge, request.sources)
    asked = [replace(spec, parameters=found.parameters, parameters_from=found.source) for found in sets]
    # The model is looked up and tried once for each set: no seed changes whether it fits.
    fitting = [use_model_in_charge(session, one, mesh_file) for one in asked]
    return [replace(one, seed=seed) for one in fitting for seed in request.seeds]


def _meshes(session: Session, request: ChargeRequest) -> dict[str, PartMesh]:
    meshes = {}
    for part, (geometry_id, units, up) in request.geometries.items():
        row = session.get(GeometryRow, geometry_id)
        if row is None:
            raise InvalidValue(f"plant.{part}.geometry", geometry_id, "the id of an uploaded geometry")
        meshes[part] = PartMesh(row.id, row.file_name, row.path, units, up)
    return meshes


def _cost(session: Session, spec: ChargeSpec, mesh_file: MeshFile) -> dict[str, Any]:
    """What it will take, and the proof that it can be run: the very test of the worker is made here."""
    cost = charge_cost(charge_test(spec, mesh_file), expected_rate(session, spec))
    return {
        "particles": cost.particles,
        "steps": cost.steps,
        "particle_steps": cost.particle_steps,
        "seconds": cost.seconds,
        "text": cost.sentence(),
    }

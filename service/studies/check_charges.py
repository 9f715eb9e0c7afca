"""Whether charges that are asked for can be made, and what each would take. Nothing is stored.

The check sets up the plant, which takes a second of processor time for a few charges and many more on a busy
machine: who stores them does so afterwards, or every other writer would wait for it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from sqlalchemy.orm import Session

from demcore.experiments.charge_cost import charge_cost
from service.db.models import GeometryRow
from service.domain.charge import ChargeRequest, ChargeSpec, MeshFile, PartMesh, charge_test
from service.domain.errors import InvalidValue
from service.studies.charge_rate import expected_rate
from service.studies.resolve_sets import resolve_sets
from service.studies.use_model import use_model_in_charge


@dataclass(frozen=True)
class CheckedCharge:
    """A charge that can be run, with its contact numbers and model looked up, and its expected cost."""

    spec: ChargeSpec
    cost: dict[str, Any]


def check_charges(session: Session, request: ChargeRequest, mesh_file: MeshFile) -> list[CheckedCharge]:
    """One for every seed and set of contact numbers. `mesh_file` gives uploaded meshes.

    Raises InvalidValue for a plant that cannot be charged, a mass that does not fit, numbers that the contact
    model does not take, a study, a geometry or a model version that is not there or does not fit, and for a charge
    that would take longer than the request allows.
    """
    specs = _specs(session, request, mesh_file)
    return [CheckedCharge(spec, _cost(session, spec, mesh_file, request.longest_hours)) for spec in specs]


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


def _cost(session: Session, spec: ChargeSpec, mesh_file: MeshFile, longest_hours: float) -> dict[str, Any]:
    """What it will take, and the proof that it can be run: the very test of the worker is made here."""
    cost = charge_cost(charge_test(spec, mesh_file), expected_rate(session, spec))
    if cost.seconds > 3600.0 * longest_hours:
        needed = f"{math.ceil(cost.seconds / 3600.0)} or more for this charge: {cost.sentence()}"
        raise InvalidValue("longest_hours", longest_hours, needed)
    return {
        "particles": cost.particles,
        "steps": cost.steps,
        "particle_steps": cost.particle_steps,
        "seconds": cost.seconds,
        "text": cost.sentence(),
    }

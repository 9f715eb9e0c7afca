"""The sets of contact numbers that a charge is to run with: given, a study's recommendation, or its ensemble."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy.orm import Session

from demcore.errors import InputError
from demcore.experiments.charge_case import load_charge
from service.db import read_models
from service.db.models import StudyRow
from service.domain.charge import ALL, SetSource
from service.domain.errors import InvalidValue
from service.domain.search_space import default_values
from service.domain.spec_record import spec_from_record


@dataclass(frozen=True)
class ParameterSet:
    """Contact numbers by material, or for ALL contacts; empty: the paper's. `source` tells where they are from."""

    parameters: Mapping[str, Mapping[str, float]]
    source: str


def resolve_sets(session: Session, charge: str, sources: Mapping[str, SetSource]) -> list[ParameterSet]:
    """One set, or as many as an ensemble has members. Raises InvalidValue for a study that is not there, is of
    another material, or has not come so far."""
    if not sources:
        return [ParameterSet({}, "paper, Table 5")]
    try:
        material = load_charge(charge).material
    except InputError as error:
        raise InvalidValue(error.field, error.value, error.allowed) from error
    found: dict[str, list[dict[str, float]]] = {}
    for name, source in sources.items():
        known = {ALL, *(grain.name for grain in material.grains)}
        if name not in known:
            raise InvalidValue("parameters", name, "one of " + ", ".join(sorted(known)))
        wanted = material.name if name == ALL else name
        found[name] = _members(session, name, wanted, source)
    count = max(len(sets) for sets in found.values())
    # A given set goes with every member of the others.
    return [
        ParameterSet(
            {name: sets[k if len(sets) > 1 else 0] for name, sets in found.items()},
            "; ".join(_told(name, source, k) for name, source in sources.items()),
        )
        for k in range(count)
    ]


def _told(name: str, source: SetSource, member: int) -> str:
    if source.study is None:
        return f"{name}: given"
    if source.members == 1:
        return f"{name}: recommended by study {source.study}"
    return f"{name}: member {member + 1} of the ensemble of study {source.study}"


def _members(session: Session, name: str, material: str, source: SetSource) -> list[dict[str, float]]:
    if source.values is not None:
        return [dict(source.values)]
    field = f"parameters.{name}.study"
    study = session.get(StudyRow, source.study)
    if study is None:
        raise InvalidValue(field, source.study, "the id of a study")
    if study.material != material:
        raise InvalidValue(field, source.study, f"a study of {material}: this one is of {study.material}")
    xs = _ensemble(session, field, study, source.members) if source.members > 1 else [_optimum(field, study)]
    spec = spec_from_record(study.spec)
    names = spec.space.names
    if not all(set(names) <= set(x) for x in xs):
        raise InvalidValue(field, study.id, "a study that gives a value to each of " + ", ".join(names))
    return [{**default_values(), **spec.parameters_of(tuple(float(x[name]) for name in names))} for x in xs]


def _optimum(field: str, study: StudyRow) -> dict[str, Any]:
    x = (study.recommendation or {}).get("x")
    if not x:
        raise InvalidValue(field, study.id, "a study that has recommended an optimum")
    return dict(x)


def _ensemble(session: Session, field: str, study: StudyRow, count: int) -> list[dict[str, Any]]:
    report = read_models.newest_report(session, study.id)
    members = ((report.content if report else {}).get("ensemble") or {}).get("members") or []
    if len(members) < count:
        allowed = f"a study whose report has {count} members: it has {len(members)}"
        raise InvalidValue(field, study.id, allowed)
    return [dict(member["x"]) for member in members[:count]]

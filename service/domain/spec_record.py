"""A StudySpec as the JSON that is stored and shown, and back: `spec_from_record(spec_to_record(s)) == s`."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

from service.domain.search_space import SearchSpace, Variable
from service.domain.study import Objective, StudySpec

PLAIN_FIELDS = (
    "material",
    "scale",
    "budget",
    "initial_designs",
    "replicates",
    "parallel",
    "seed",
    "fill_level",
    "time_step",
)


def spec_to_record(spec: StudySpec) -> dict[str, Any]:
    """Plain JSON types only; variables in the order of the space."""
    return {
        **{name: getattr(spec, name) for name in PLAIN_FIELDS},
        "objective": {
            "target_deg": spec.objective.target_deg,
            "window_deg": list(spec.objective.window_deg),
            "tolerance_deg": spec.objective.tolerance_deg,
        },
        "variables": {
            v.name: {"lower": v.lower, "upper": v.upper, "step": v.step} for v in spec.space.variables
        },
        "fixed": dict(spec.fixed),
    }


def spec_from_record(record: Mapping[str, Any]) -> StudySpec:
    """The spec that was stored; validated again by its own constructors."""
    objective = record["objective"]
    lower, upper = objective["window_deg"]
    return StudySpec(
        space=SearchSpace(tuple(Variable(name, **row) for name, row in record["variables"].items())),
        objective=Objective(objective["target_deg"], (lower, upper), objective["tolerance_deg"]),
        fixed=record["fixed"],
        **{name: record[name] for name in PLAIN_FIELDS},
    )


def design_hash(names: Sequence[str], x: Sequence[float], fixed: Mapping[str, float]) -> str:
    """sha256 of all contact parameters of a design, searched or fixed: its key beside scale and seed."""
    values = {**dict(zip(names, x, strict=True)), **fixed}
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()

"""A StudySpec as the JSON that is stored and shown, and back: `spec_from_record(spec_to_record(s)) == s`.

Records of the first version hold one `objective` in degrees and no strategy; `upgraded` reads them as the study
that they were. Stored JSON is never changed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from service.domain.model_use import ModelUse
from service.domain.observables import ANGLE
from service.domain.search_space import SearchSpace, Variable
from service.domain.study import CoarsePrior, Response, StudySpec, TableRow

PLAIN_FIELDS = (
    "material",
    "scale",
    "strategy",
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
    coarse = spec.coarse
    return {
        **{name: getattr(spec, name) for name in PLAIN_FIELDS},
        "responses": [_response_record(response) for response in spec.responses],
        "variables": {
            v.name: {"lower": v.lower, "upper": v.upper, "step": v.step} for v in spec.space.variables
        },
        "fixed": dict(spec.fixed),
        "derived": dict(spec.derived),
        "table": [
            {"x": dict(row.x), "results": None if row.results is None else dict(row.results)}
            for row in spec.table
        ],
        "coarse": None if coarse is None else {"scale": coarse.scale, "runs": coarse.runs},
        "warm_start": list(spec.warm_start),
        # Left out where there is none, as in every record before there were versions.
        **({} if spec.model is None else {"model": spec.model.as_record()}),
    }


def request_of(record: Mapping[str, Any]) -> dict[str, Any]:
    """The body of POST /v1/studies that asks for a stored study again, whatever release stored it."""
    stored = upgraded(record)
    model = stored.pop("model", None)
    asked = {name: value for name, value in stored.items() if value not in (None, {}, [])}
    if model:
        asked |= {"model_version": model["name"], "moisture_percent": model["moisture_percent"]}
    return asked


def _response_record(response: Response) -> dict[str, Any]:
    return {
        "observable": response.observable,
        "target": response.target,
        "window": list(response.window),
        "tolerance": response.tolerance,
        "uncertainty": response.uncertainty,
    }


def upgraded(record: Mapping[str, Any]) -> dict[str, Any]:
    """A stored record of any version as one of today's."""
    if "objective" not in record:
        return dict(record)
    old = record["objective"]
    angle = {
        "observable": ANGLE,
        "target": old["target_deg"],
        "window": list(old["window_deg"]),
        "tolerance": old["tolerance_deg"],
        "uncertainty": 0.0,
    }
    new: dict[str, Any] = {"strategy": "auto", "derived": {}, "table": [], "coarse": None, "warm_start": []}
    rest = {name: value for name, value in record.items() if name != "objective"}
    return {**new, **rest, "responses": [angle]}


def primary_response(record: Mapping[str, Any]) -> dict[str, Any]:
    """The first response of a stored record: observable, target, window, tolerance, uncertainty."""
    first: dict[str, Any] = upgraded(record)["responses"][0]
    return first


def spec_from_record(record: Mapping[str, Any]) -> StudySpec:
    """The spec that was stored; validated again by its own constructors."""
    stored = upgraded(record)
    return StudySpec(
        space=SearchSpace(tuple(Variable(name, **row) for name, row in stored["variables"].items())),
        responses=tuple(_response(row) for row in stored["responses"]),
        fixed=stored["fixed"],
        derived=stored["derived"],
        table=tuple(TableRow(row["x"], row["results"]) for row in stored["table"]),
        coarse=None if stored["coarse"] is None else CoarsePrior(**stored["coarse"]),
        warm_start=tuple(stored["warm_start"]),
        model=ModelUse(**stored["model"]) if stored.get("model") else None,
        **{name: stored[name] for name in PLAIN_FIELDS},
    )


def _response(row: Mapping[str, Any]) -> Response:
    lower, upper = row["window"]
    return Response(row["observable"], row["target"], (lower, upper), row["tolerance"], row["uncertainty"])


def design_hash(parameters: Mapping[str, float]) -> str:
    """sha256 of all contact parameters of a design (`StudySpec.parameters_of`): its key beside scale and seed."""
    return hashlib.sha256(json.dumps(dict(parameters), sort_keys=True).encode()).hexdigest()

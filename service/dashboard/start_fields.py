"""The fields of the forms that start work: start_fields.toml, with choices and ranges of the domain."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.resources import files
from typing import Any

from demcore.experiments.charge_case import charge_names
from demcore.material import load_material, material_names
from service.dashboard.words import parameter_name
from service.db.models import DataSetRow, ModelVersionRow
from service.domain.diagnosis import CONTACT_MODELS
from service.domain.search_space import PAPER_PARAMETERS
from service.domain.strategy import STRATEGIES

Choices = tuple[tuple[str, str], ...]

SEARCHED = "What to search"
PAPER = "the paper (Degrassi et al. 2021)"


@dataclass(frozen=True)
class Field:
    """One input, in the words of the table. `kind`: number, whole, choice, wholes (several, by commas), switch,
    text or file."""

    path: str
    label: str
    kind: str
    help: str
    source: str = ""
    unit: str = ""
    low: float | None = None
    high: float | None = None
    default: str = ""
    value: str = ""
    choices: Choices = ()
    is_required: bool = False
    refused_as: tuple[str, ...] = ()

    @property
    def range(self) -> str:
        """0.1 to 20, for the eye."""
        return "" if self.low is None or self.high is None else f"{self.low:.12g} to {self.high:.12g}"


@dataclass(frozen=True)
class FieldGroup:
    """Fields under one title; `is_advanced` ones are folded away."""

    title: str
    fields: tuple[Field, ...]
    is_advanced: bool = False


def study_fields(versions: Sequence[ModelVersionRow] = ()) -> tuple[FieldGroup, ...]:
    """Of POST /v1/studies. `versions`: of the model, that may be used."""
    choices = {
        "material": tuple((name, _material(name)) for name in material_names()),
        "strategy": tuple((name, f"{name.replace('_', ' ')}: {told}") for name, told in STRATEGIES.items()),
        "model_version": _versions(versions),
    }
    groups = _groups("study", choices)
    return tuple(replace(g, fields=_ranges()) if g.title == SEARCHED else g for g in groups)


def charge_fields() -> tuple[FieldGroup, ...]:
    """Of POST /v1/charges."""
    return _groups("charge", {"charge": tuple((name, name) for name in charge_names())})


def measurement_fields() -> tuple[FieldGroup, ...]:
    """Of POST /v1/measurements."""
    return _groups("measurement", {})


def diagnosis_fields(
    stored: Sequence[DataSetRow], chosen: int | None, versions: Sequence[ModelVersionRow] = ()
) -> tuple[FieldGroup, ...]:
    """Of POST /v1/diagnoses. `stored`: the data sets that may be diagnosed; `chosen`: the one to begin with;
    `versions`: of the model, that may be used."""
    choices = {
        "data_set": tuple((str(row.id), f"{row.id}: {row.name}") for row in stored),
        "contact_model": tuple((name, name.replace("_", " ")) for name in CONTACT_MODELS),
        "model_version": _versions(versions),
    }
    return _groups("diagnosis", choices, {} if chosen is None else {"data_set": str(chosen)})


def _versions(versions: Sequence[ModelVersionRow]) -> Choices:
    return (("", "baseline"), *((row.name, row.name) for row in versions))


def _material(name: str) -> str:
    one = load_material(name)
    lower, upper = one.window_deg
    return f"{name} (repose angle {one.target_deg:g}°, {lower:g} to {upper:g}°)"


def _ranges() -> tuple[Field, ...]:
    """Both ends of each range that a study searches."""
    return tuple(
        Field(
            path=f"variables.{name}.{end}",
            label=f"{parameter_name(name)}, {word}",
            kind="number",
            help=f"{limit.meaning[0].upper()}{limit.meaning[1:]}.",
            source=PAPER,
            low=limit.lower,
            high=limit.upper,
            default=f"{default:g}",
        )
        for name, limit in PAPER_PARAMETERS.items()
        for end, word, default in (
            ("lower", "from", limit.default_lower),
            ("upper", "to", limit.default_upper),
        )
    )


@lru_cache(maxsize=1)
def _table() -> Mapping[str, Any]:
    return tomllib.loads(files("service.dashboard").joinpath("start_fields.toml").read_text(encoding="utf-8"))


def _groups(
    form: str, choices: Mapping[str, Choices], values: Mapping[str, str] | None = None
) -> tuple[FieldGroup, ...]:
    values = values or {}
    return tuple(
        FieldGroup(
            group["title"],
            tuple(_field(row, choices, values) for row in group.get("fields", ())),
            group.get("is_advanced", False),
        )
        for group in _table()[form]
    )


def _field(row: Mapping[str, Any], choices: Mapping[str, Choices], values: Mapping[str, str]) -> Field:
    path = row["path"]
    own = choices.get(path) or tuple((value, text) for value, text in row.get("choices", ()))
    known = {**row, "choices": own, "refused_as": tuple(row.get("refused_as", ()))}
    return Field(**{**known, "value": values.get(path, row.get("value", ""))})

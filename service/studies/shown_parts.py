"""What pages and charges read of a recommendation and a report: a study file that has it otherwise is refused.

Only the shape of these fields is held; whatever else such a part holds travels with it as it is.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Set = dict[str, Number]


class _Part(BaseModel):
    model_config = ConfigDict(extra="allow")


class _Recommendation(_Part):
    x: Set
    mean_deg: Number | None = None
    half_width_90_deg: Number | None = None
    expected_miss_deg: Number | None = None
    window_probability: Number | None = None
    certified: Annotated[bool, Field(strict=True)] | None = None
    replicates_deg: list[Number] | None = None
    numbers: list[Annotated[int, Field(strict=True)]] | None = None


class _Parameter(_Part):
    name: str
    lower_90: Number | None
    upper_90: Number | None
    sd_ratio: Number | None
    label: str


class _Posterior(_Part):
    parameters: list[_Parameter]
    text: list[str]


class _Test(_Part):
    text: str


class _Member(_Part):
    x: Set


class _Ensemble(_Part):
    members: list[_Member]


class _Report(_Part):
    enough: Annotated[bool, Field(strict=True)]
    text: str | None = None
    posterior: _Posterior | None = None
    which_test_next: list[_Test] = []
    ensemble: _Ensemble | None = None


def recommendation_part(value: dict[str, Any]) -> dict[str, Any]:
    """`value` itself. Raises ValueError."""
    return _checked(_Recommendation, value)


def report_part(value: dict[str, Any]) -> dict[str, Any]:
    """`value` itself. Raises ValueError."""
    checked = _checked(_Report, value)
    if value["enough"] and value.get("posterior") is None:
        raise ValueError("posterior: it is missing where there is enough for one")
    return checked


def _checked(shape: type[_Part], value: dict[str, Any]) -> dict[str, Any]:
    try:
        shape.model_validate(value)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        raise ValueError(f"{'.'.join(map(str, first['loc']))}: {first['msg']}") from None
    return value

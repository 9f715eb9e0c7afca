"""Charges beside each other: coke against iron, two scales, sets of contact numbers, or a charge and its plant."""

from __future__ import annotations

import math
from typing import Annotated, Any, Self

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy.orm import Session

from demcore.errors import InputError
from demcore.experiments.charge_comparison import (
    Agreement,
    Group,
    PressureAgreement,
    Row,
    against_plant,
    against_pressures,
    compare,
    read_heights,
    read_pressures,
)
from service.api.dependencies import DatabaseDep
from service.api.problems import problem_responses
from service.api.study_parts import STRICT
from service.db.models import ChargeRow
from service.domain.errors import InvalidValue
from service.errors import Conflict

router = APIRouter(prefix="/v1/charges", tags=["charges"])


class ComparisonBody(BaseModel):
    """Finished charges by group, and what was measured in the plant."""

    model_config = ConfigDict(
        **STRICT, json_schema_extra={"examples": [{"groups": {"coke": [1, 2, 3], "iron": [4, 5, 6]}}]}
    )

    groups: Annotated[dict[str, list[int]], Field(description="ids of charges by the group's name")]
    plant_heights: Annotated[
        str | None,
        Field(description="CSV with azimuth_deg and height_m above the bell's seat, of the plant's burden"),
    ] = None
    plant_pressures: Annotated[
        str | None,
        Field(description="CSV with azimuth_deg and pressure_kpa of taps below the hopper, four at least"),
    ] = None


class GroupBody(BaseModel):
    """A number over the charges of a group."""

    mean: float | None
    sd: float | None = Field(description="null for one charge")
    charges: int

    @classmethod
    def of(cls, group: Group) -> Self:
        return cls(mean=_finite(group.mean), sd=_finite(group.sd), charges=group.charges)


class RowBody(BaseModel):
    """One number by group; of two groups the difference of the means beside its noise."""

    name: str
    unit: str
    groups: dict[str, GroupBody]
    difference: float | None
    noise: float | None = Field(description="sqrt(s1^2/n1 + s2^2/n2); null where a group has one charge")
    stands_out: bool | None = Field(description="the difference is more than twice its noise")

    @classmethod
    def of(cls, row: Row) -> Self:
        return cls(
            name=row.name,
            unit=row.unit,
            groups={name: GroupBody.of(group) for name, group in row.groups.items()},
            difference=_finite(row.difference),
            noise=_finite(row.noise),
            stands_out=row.stands_out,
        )


class AgreementBody(BaseModel):
    """A charge against measured heights."""

    charge_id: int
    here_m: list[float] = Field(description="its heights at the measured azimuths")
    bias_m: float
    rms_m: float
    correlation: float | None

    @classmethod
    def of(cls, charge_id: int, found: Agreement) -> Self:
        return cls(
            charge_id=charge_id,
            here_m=list(found.here_m),
            bias_m=found.bias_m,
            rms_m=found.rms_m,
            correlation=_finite(found.correlation),
        )


class PressureAgreementBody(BaseModel):
    """A charge against pressure taps, which tell where its layer is thick and not how thick."""

    charge_id: int
    here_m: list[float] = Field(description="its heights at the taps")
    rank_correlation: float | None = Field(
        description="of height and pressure; its sign depends on how the layer's material lets gas through"
    )
    as_strong_when_turned: float | None = Field(
        description="share of turnings of the profile about the axis that agree at least as strongly"
    )

    @classmethod
    def of(cls, charge_id: int, found: PressureAgreement) -> Self:
        return cls(
            charge_id=charge_id,
            here_m=list(found.here_m),
            rank_correlation=_finite(found.rank_correlation),
            as_strong_when_turned=_finite(found.as_strong_when_turned),
        )


class ComparisonTable(BaseModel):
    """Every number of the groups, and each charge against what was measured in the plant, where that was given."""

    rows: list[RowBody]
    plant: list[AgreementBody]
    pressures: list[PressureAgreementBody]


@router.post(
    "/comparison", operation_id="compareCharges", responses=problem_responses(409, 422), status_code=200
)
def post_comparison(body: ComparisonBody, database: DatabaseDep) -> ComparisonTable:
    """Set finished charges beside each other; nothing is stored."""
    with database.reading() as session:
        groups = {
            name: {number: _results(session, name, number) for number in ids}
            for name, ids in body.groups.items()
        }
    try:
        rows = compare({name: list(of.values()) for name, of in groups.items()})
        heights = None if body.plant_heights is None else read_heights(body.plant_heights)
        taps = None if body.plant_pressures is None else read_pressures(body.plant_pressures)
    except InputError as error:
        raise InvalidValue(error.field, error.value, error.allowed) from error
    charges = [pair for of in groups.values() for pair in of.items()]
    plant = [] if heights is None else [AgreementBody.of(n, against_plant(s, heights)) for n, s in charges]
    pressures = (
        [] if taps is None else [PressureAgreementBody.of(n, against_pressures(s, taps)) for n, s in charges]
    )
    return ComparisonTable(rows=[RowBody.of(row) for row in rows], plant=plant, pressures=pressures)


def _results(session: Session, group: str, charge_id: int) -> dict[str, Any]:
    row = session.get(ChargeRow, charge_id) if 0 < charge_id < 2**63 else None
    if row is None:
        raise InvalidValue(f"groups.{group}", charge_id, "the id of a charge")
    if row.results is None:
        raise Conflict(f"Charge {charge_id} has no results: it is {row.state.value}.")
    return row.results


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None

"""The body of POST /v1/charges, and the ChargeRequest that it means. Only shapes are checked here."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from service.api.study_parts import STRICT, ModelVersion, Moisture
from service.domain.charge import LONGEST_HOURS, ChargeRequest, ChargeSpec, SetSource
from service.domain.errors import InvalidValue
from service.domain.model_use import ModelUse

# Beside its numbers, a part of the plant may name an uploaded mesh.
GEOMETRY, UNITS, UP = "geometry", "units", "up"


class SetBody(BaseModel):
    """Contact numbers of a material: given, or those of a study."""

    model_config = ConfigDict(**STRICT)

    values: Annotated[
        dict[str, float] | None,
        Field(
            description="the paper's four, and any other of the contact model",
            examples=[
                {
                    "particle_particle_static_friction": 0.5,
                    "particle_wall_static_friction": 0.8,
                    "particle_particle_restitution": 0.24,
                    "rolling_resistance": 0.48,
                }
            ],
        ),
    ] = None
    study: Annotated[int | None, Field(description="id of a study: its recommendation, or its ensemble")] = (
        None
    )
    members: Annotated[int, Field(description="of the study's ensemble, a charge each; 1: its optimum")] = 1


class ChargeBody(BaseModel):
    """Charges of the hopper by belt and deflector. `{"charge": "coke"}` is enough."""

    model_config = ConfigDict(
        **STRICT,
        json_schema_extra={
            "examples": [
                {"charge": "coke"},
                {
                    "charge": "iron",
                    "scale": 6.0,
                    "seeds": [1, 2, 3],
                    "plant": {"deflector": {"ridge_across_mm": -150.0, "near_pitch_deg": 50.0}},
                    "parameters": {"sinter": {"study": 1}, "pellet": {"study": 2}},
                },
            ]
        },
    )

    charge: Annotated[str, Field(description="the name of a shipped charge", examples=["coke", "iron"])]
    scale: Annotated[float, Field(description="coarse-graining: grain diameters times this")] = 4.0
    seeds: Annotated[list[int], Field(description="a charge for each", max_length=50)] = [1]
    rest_seconds: Annotated[float, Field(description="simulated time after the last grain came")] = 10.0
    dormancy: Annotated[bool, Field(description="hold grains that do nothing")] = True
    frame_seconds: Annotated[
        float | None, Field(description="simulated time between frames of the series; null: no series")
    ] = 2.0
    plant: Annotated[
        dict[str, dict[str, float | str]],
        Field(
            description="what differs from the shipped plant, by part and key as in demcore/data/plant.toml; "
            "`geometry` with `units` (and `up`) puts an uploaded mesh in a part's place",
            examples=[{"deflector": {"ridge_across_mm": -150.0}}],
        ),
    ] = {}
    parameters: Annotated[
        dict[str, SetBody],
        Field(description="contact numbers by material, or under `all`; the paper's where left out"),
    ] = {}
    longest_hours: Annotated[
        float, Field(description="a charge that would take longer is refused before it starts")
    ] = LONGEST_HOURS
    model_version: ModelVersion = None
    moisture_percent: Moisture = 0.0

    def to_request(self) -> ChargeRequest:
        """The charges asked for. Raises InvalidValue."""
        plant: dict[str, dict[str, float]] = {}
        geometries: dict[str, tuple[int, str, str]] = {}
        for part, row in self.plant.items():
            if GEOMETRY in row:
                geometries[part] = _geometry(part, row)
            numbers = {key: value for key, value in row.items() if key not in (GEOMETRY, UNITS, UP)}
            for key, value in numbers.items():
                if isinstance(value, str):
                    raise InvalidValue(f"plant.{part}.{key}", value, "a number")
            if numbers:
                plant[part] = {key: float(value) for key, value in numbers.items()}
        spec = ChargeSpec(
            charge=self.charge,
            scale=self.scale,
            rest_seconds=self.rest_seconds,
            dormancy=self.dormancy,
            frame_seconds=self.frame_seconds,
            plant=plant,
            model=ModelUse.asked(self.model_version, self.moisture_percent),
        )
        sources = {
            name: SetSource(body.values, body.study, body.members) for name, body in self.parameters.items()
        }
        return ChargeRequest(spec, tuple(self.seeds), sources, geometries, self.longest_hours)


def _geometry(part: str, row: dict[str, float | str]) -> tuple[int, str, str]:
    number, units, up = row[GEOMETRY], row.get(UNITS), row.get(UP, "z")
    if isinstance(number, str) or number != int(number):
        raise InvalidValue(f"plant.{part}.geometry", number, "the id of an uploaded geometry")
    if not isinstance(units, str) or not isinstance(up, str):
        raise InvalidValue(f"plant.{part}.units", units, "m, mm, cm or inch: a mesh does not say its own")
    return int(number), units, up

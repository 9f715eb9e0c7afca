"""The body of POST /v1/studies, and the StudySpec that it means. Only shapes are checked here: values are the
domain's business, so that every way in has the same limits."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from demcore.errors import InputError
from demcore.material import Material, load_material
from demcore.rig import coarsest_scale, load_rig
from service.api.study_parts import (
    MOST_ROWS,
    STRICT,
    CoarseBody,
    ModelVersion,
    Moisture,
    ObjectiveBody,
    ResponseBody,
    TableRowBody,
    VariableBody,
    rows_of_csv,
)
from service.domain.errors import InvalidValue
from service.domain.model_use import ModelUse
from service.domain.observables import ANGLE, OBSERVABLES
from service.domain.search_space import PARAMETERS, SearchSpace, Variable, default_space, default_values
from service.domain.strategy import STRATEGIES
from service.domain.study import CoarsePrior, Response, StudySpec, TableRow


class StudyBody(BaseModel):
    """A calibration to run. `{"material": "pellet"}` is enough."""

    model_config = ConfigDict(
        **STRICT,
        json_schema_extra={
            "examples": [
                {"material": "pellet"},
                {
                    "material": "coke",
                    "scale": 3.0,
                    "objective": {"target_deg": 36.5, "window_deg": [35.0, 38.0], "tolerance_deg": 0.5},
                    "variables": {
                        "particle_particle_static_friction": {"lower": 0.1, "upper": 0.9, "step": 0.01},
                        "rolling_resistance": {"lower": 0.05, "upper": 0.6, "step": 0.01},
                    },
                    "fixed": {"particle_wall_static_friction": 0.5, "particle_particle_restitution": 0.3},
                    "budget": 20,
                    "seed": 1,
                },
            ]
        },
    )

    material: Annotated[str, Field(description="the name of a shipped material", examples=["pellet"])]
    scale: Annotated[
        float | None,
        Field(
            description="coarse-graining: particle diameters times this; default: the coarsest that keeps 12 "
            "mean diameters along the base's radius (coke 2.1, sinter 3.1, pellet 1.7)"
        ),
    ] = None
    objective: Annotated[
        ObjectiveBody | None, Field(description="short for `responses` with the repose angle alone")
    ] = None
    responses: Annotated[
        list[ResponseBody] | None,
        Field(
            min_length=1,
            max_length=20,
            description="default: the material's repose angle; the first is shown",
        ),
    ] = None
    strategy: Annotated[str, Field(description="one of " + ", ".join(STRATEGIES))] = "auto"
    variables: Annotated[
        dict[str, VariableBody] | None,
        Field(description="default: the paper's four, over their default ranges"),
    ] = None
    fixed: Annotated[
        dict[str, float],
        Field(description="parameters that are not searched; the middle of the default range where left out"),
    ] = {}
    derived: Annotated[
        dict[str, str],
        Field(
            description="parameters that follow from others",
            examples=[{"particle_wall_rolling_resistance": "0.5 * rolling_resistance"}],
        ),
    ] = {}
    table: Annotated[
        list[TableRowBody], Field(max_length=MOST_ROWS, description="designs to run, or known already")
    ] = []
    table_csv: Annotated[
        str | None,
        Field(description="the same as text: a header of parameters and observables, a row a design"),
    ] = None
    coarse: CoarseBody | None = None
    warm_start: Annotated[list[int], Field(description="ids of finished studies of the same test")] = []
    budget: Annotated[int, Field(description="simulations at most, 1 to 1000")] = 30
    initial_designs: Annotated[int, Field(description="simulations before the surrogate speaks")] = 6
    replicates: Annotated[int, Field(description="seeds that a certificate needs")] = 3
    parallel: Annotated[int, Field(description="simulations in flight")] = 2
    seed: Annotated[int, Field(description="the same seed gives the same designs")] = 1
    fill_level: Annotated[float, Field(description="share of the cylinder that is filled, 0.1 to 1")] = 1.0
    time_step: Annotated[str, Field(description="fast or paper")] = "fast"
    model_version: ModelVersion = None
    moisture_percent: Moisture = 0.0

    def to_spec(self) -> StudySpec:
        """The study asked for, with the material's defaults. Raises InvalidValue."""
        material = _material(self.material)
        scale = coarsest_scale(load_rig(material.name), material.sizes.mean_diameter)
        if self.scale is not None:
            _check_scale("scale", self.scale, material)
            scale = self.scale
        if self.coarse is not None:
            _check_scale("coarse.scale", self.coarse.scale, material)
        return StudySpec(
            material=material.name,
            scale=scale,
            space=self._space(),
            responses=self._responses(material),
            strategy=self.strategy,
            budget=self.budget,
            initial_designs=self.initial_designs,
            replicates=self.replicates,
            parallel=self.parallel,
            seed=self.seed,
            fixed=self._fixed(),
            derived=self.derived,
            table=self._table(),
            coarse=None if self.coarse is None else CoarsePrior(self.coarse.scale, self.coarse.runs),
            warm_start=tuple(self.warm_start),
            fill_level=self.fill_level,
            time_step=self.time_step,
            model=ModelUse.asked(self.model_version, self.moisture_percent),
        )

    def _space(self) -> SearchSpace:
        if self.variables is None:
            default = default_space()
            # A parameter that is fixed or derived is not searched; their order stays the paper's.
            said = {*self.fixed, *self.derived}
            return SearchSpace(tuple(v for v in default.variables if v.name not in said))
        return SearchSpace(tuple(_variable(name, body) for name, body in self.variables.items()))

    def _fixed(self) -> dict[str, float]:
        """Every parameter that is not searched has a stored value: a design is then complete by itself."""
        searched = {*self._space().names, *self.derived}
        middles = {name: value for name, value in default_values().items() if name not in searched}
        return {**middles, **self.fixed}

    def _table(self) -> tuple[TableRow, ...]:
        if self.table_csv is None:
            return tuple(row.to_row() for row in self.table)
        if self.table:
            raise InvalidValue("table_csv", "a table as well", "one of table and table_csv")
        return rows_of_csv(self.table_csv)

    def _responses(self, material: Material) -> tuple[Response, ...]:
        if self.responses is None:
            return (_angle(self.objective or ObjectiveBody(), material),)
        if self.objective is not None:
            raise InvalidValue("objective", "an objective as well", "one of objective and responses")
        return tuple(_response(body, material) for body in self.responses)


def _angle(asked: ObjectiveBody, material: Material) -> Response:
    """The repose angle; refusals name the objective's fields."""
    target = material.target_deg if asked.target_deg is None else asked.target_deg
    window = _window(asked.window_deg) or _material_window(target, material)
    try:
        return Response(ANGLE, target, window, asked.tolerance_deg)
    except InvalidValue as error:
        _, _, name, *rest = error.field.split(".")
        raise InvalidValue(
            ".".join(["objective", f"{name}_deg", *rest]), error.value, error.allowed
        ) from error


def _response(asked: ResponseBody, material: Material) -> Response:
    name = asked.observable
    if name not in OBSERVABLES:
        raise InvalidValue("responses.observable", name, "one of " + ", ".join(OBSERVABLES))
    target = asked.target
    if target is None and name == ANGLE:
        target = material.target_deg
    if target is None:
        raise InvalidValue(f"responses.{name}.target", None, f"required, in {OBSERVABLES[name].unit}")
    tolerance = asked.tolerance
    if tolerance is None:
        tolerance = 0.5 if name == ANGLE else round(0.05 * abs(target), 12)
    window = _window(asked.window)
    if window is None and name == ANGLE:
        window = _material_window(target, material)
    if window is None:
        window = (round(target - 2 * tolerance, 12), round(target + 2 * tolerance, 12))
    return Response(name, target, window, tolerance, asked.uncertainty)


def _window(asked: list[float] | None) -> tuple[float, float] | None:
    return None if asked is None else (asked[0], asked[1])


def _material_window(target: float, material: Material) -> tuple[float, float]:
    """The material's own window, moved along; rounded, because 30.1 + 0.5 is 30.600000000000001 and is shown."""
    lower, upper = (round(target + limit - material.target_deg, 9) for limit in material.window_deg)
    return lower, upper


def _material(name: str) -> Material:
    try:
        return load_material(name)
    except InputError as error:
        raise InvalidValue(error.field, error.value, error.allowed) from error


def _variable(name: str, body: VariableBody) -> Variable:
    limit = PARAMETERS.get(name)
    lower: Any = body.lower if body.lower is not None or limit is None else limit.default_lower
    upper: Any = body.upper if body.upper is not None or limit is None else limit.default_upper
    step = body.step
    if "step" not in body.model_fields_set and limit is not None and limit.upper > 100.0:
        step = None  # pascals: two decimals mean nothing
    return Variable(name, lower, upper, step)


def _check_scale(field: str, scale: float, material: Material) -> None:
    """Two of the largest particles must fit across the rig's cylinder; later, each design would fail for it."""
    largest = load_rig(material.name).cylinder_radius / material.sizes.largest
    if scale > largest:
        # Rounded down: the number that is told must be one that is taken.
        told = math.floor(10.0 * largest) / 10.0
        raise InvalidValue(field, scale, f"at most {told:g} for {material.name}, whose rig is small")

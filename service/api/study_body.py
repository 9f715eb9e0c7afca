"""The body of POST /v1/studies, and the StudySpec that it means. Only shapes are checked here: values are the
domain's business, so that every way in has the same limits."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from demcore.errors import InputError
from demcore.material import Material, load_material
from demcore.rig import coarsest_scale, load_rig
from service.domain.errors import InvalidValue
from service.domain.observables import ANGLE
from service.domain.search_space import PARAMETERS, SearchSpace, Variable, default_space, default_values
from service.domain.study import Response, StudySpec

_STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class ObjectiveBody(BaseModel):
    """What to reach. Left out: the material's own repose angle and window."""

    model_config = _STRICT

    target_deg: Annotated[float | None, Field(description="default: the material's")] = None
    window_deg: Annotated[
        list[float] | None,
        Field(min_length=2, max_length=2, description="default: the material's, moved along with the target"),
    ] = None
    tolerance_deg: Annotated[float, Field(description="expected miss that the certificate allows")] = 0.5


class VariableBody(BaseModel):
    """The range of one searched parameter. Left out: its default."""

    model_config = _STRICT

    lower: float | None = None
    upper: float | None = None
    step: Annotated[float | None, Field(description="resolution of the designs; null: none")] = 0.01


class StudyBody(BaseModel):
    """A calibration to run. `{"material": "pellet"}` is enough."""

    model_config = ConfigDict(
        **_STRICT,
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
    objective: ObjectiveBody = ObjectiveBody()
    variables: Annotated[
        dict[str, VariableBody] | None,
        Field(description="default: the paper's four, over their default ranges"),
    ] = None
    fixed: Annotated[
        dict[str, float],
        Field(description="parameters that are not searched; the middle of the default range where left out"),
    ] = {}
    budget: Annotated[int, Field(description="simulations at most, 1 to 1000")] = 30
    initial_designs: Annotated[int, Field(description="simulations before the surrogate speaks")] = 6
    replicates: Annotated[int, Field(description="seeds that a certificate needs")] = 3
    parallel: Annotated[int, Field(description="simulations in flight")] = 2
    seed: Annotated[int, Field(description="the same seed gives the same designs")] = 1
    fill_level: Annotated[float, Field(description="share of the cylinder that is filled, 0.1 to 1")] = 1.0
    time_step: Annotated[str, Field(description="fast or paper")] = "fast"

    def to_spec(self) -> StudySpec:
        """The study asked for, with the material's defaults. Raises InvalidValue."""
        material = _material(self.material)
        scale = coarsest_scale(load_rig(material.name), material.sizes.mean_diameter)
        if self.scale is not None:
            _check_scale(self.scale, material)
            scale = self.scale
        return StudySpec(
            material=material.name,
            scale=scale,
            space=self._space(),
            responses=(self._response(material),),
            budget=self.budget,
            initial_designs=self.initial_designs,
            replicates=self.replicates,
            parallel=self.parallel,
            seed=self.seed,
            fixed=self._fixed(),
            fill_level=self.fill_level,
            time_step=self.time_step,
        )

    def _space(self) -> SearchSpace:
        if self.variables is None:
            default = default_space()
            # A parameter that is fixed is not searched; Variable order stays the paper's.
            return SearchSpace(tuple(v for v in default.variables if v.name not in self.fixed))
        return SearchSpace(tuple(_variable(name, body) for name, body in self.variables.items()))

    def _fixed(self) -> dict[str, float]:
        """Every parameter that is not searched has a stored value: a design is then complete by itself."""
        searched = set(self._space().names)
        middles = {name: value for name, value in default_values().items() if name not in searched}
        return {**middles, **self.fixed}

    def _response(self, material: Material) -> Response:
        asked = self.objective
        target = material.target_deg if asked.target_deg is None else asked.target_deg
        if asked.window_deg is not None:
            window = (asked.window_deg[0], asked.window_deg[1])
        else:
            # Rounded, because 30.1 + 0.5 is 30.600000000000001 and is shown to people.
            lower, upper = (round(target + limit - material.target_deg, 9) for limit in material.window_deg)
            window = (lower, upper)
        try:
            return Response(ANGLE, target, window, asked.tolerance_deg)
        except InvalidValue as error:
            _, _, name, *rest = error.field.split(".")
            raise InvalidValue(
                ".".join(["objective", f"{name}_deg", *rest]), error.value, error.allowed
            ) from error


def _material(name: str) -> Material:
    try:
        return load_material(name)
    except InputError as error:
        raise InvalidValue(error.field, error.value, error.allowed) from error


def _variable(name: str, body: VariableBody) -> Variable:
    limit = PARAMETERS.get(name)
    lower: Any = body.lower if body.lower is not None or limit is None else limit.default_lower
    upper: Any = body.upper if body.upper is not None or limit is None else limit.default_upper
    return Variable(name, lower, upper, body.step)


def _check_scale(scale: float, material: Material) -> None:
    """Two of the largest particles must fit across the rig's cylinder; later, each design would fail for it."""
    largest = load_rig(material.name).cylinder_radius / material.sizes.largest
    if scale > largest:
        raise InvalidValue("scale", scale, f"at most {largest:.2g} for {material.name}, whose rig is small")

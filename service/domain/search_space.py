"""The space that a study searches: named parameters of the contact model with bounds and steps.

Notation: `x` is a design in physical units, a tuple in the order of `SearchSpace.variables`; `u` is the
same point in the unit cube.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from service.domain.errors import InvalidValue


@dataclass(frozen=True)
class ParameterRange:
    """The widest range that the contact model accepts, the default search range, and what it is."""

    lower: float
    upper: float
    default_lower: float
    default_upper: float
    meaning: str

    @property
    def middle(self) -> float:
        """Of the default search range."""
        return round((self.default_lower + self.default_upper) / 2.0, 12)


# The four variables of the paper (section 2.1). The default ranges hold its optima (Table 5) with room on
# both sides; the outer limits are the contact model's own (e = 0 makes the unloading stiffness infinite).
PAPER_PARAMETERS: Mapping[str, ParameterRange] = {
    "particle_particle_static_friction": ParameterRange(
        0.0, 2.0, 0.1, 0.9, "Coulomb friction between particles before they slide"
    ),
    "particle_wall_static_friction": ParameterRange(
        0.0, 2.0, 0.1, 0.9, "Coulomb friction between a particle and steel before it slides"
    ),
    "particle_particle_restitution": ParameterRange(
        0.05, 1.0, 0.1, 0.6, "rebound over impact speed of two particles"
    ),
    "rolling_resistance": ParameterRange(
        0.0, 5.0, 0.05, 0.6, "limit of the rolling couple over normal force and rolling radius (type 3)"
    ),
}

# The rest of the contact model. Where a study neither searches, fixes nor derives one of these, the material's
# own value holds, or (rolling at walls) that of the grains: there is no number that suits every material.
FURTHER_PARAMETERS: Mapping[str, ParameterRange] = {
    "particle_wall_restitution": ParameterRange(
        0.05, 1.0, 0.1, 0.6, "rebound over impact speed of a particle at steel"
    ),
    "particle_wall_rolling_resistance": ParameterRange(
        0.0, 5.0, 0.05, 0.6, "rolling resistance of a particle on steel"
    ),
    "dynamic_friction_ratio": ParameterRange(
        0.0, 1.0, 0.5, 1.0, "dynamic over static friction, of all contacts"
    ),
    "youngs_modulus_pa": ParameterRange(
        1e5, 1e11, 1e6, 1e8, "Young's modulus of the grains in the simulation"
    ),
    "poisson_ratio": ParameterRange(0.0, 0.49, 0.15, 0.35, "Poisson ratio of the grains"),
    "particle_particle_dynamic_friction": ParameterRange(
        0.0,
        2.0,
        0.1,
        0.8,
        "Coulomb friction between sliding particles, at most the static one",
    ),
    "particle_wall_dynamic_friction": ParameterRange(
        0.0, 2.0, 0.1, 0.8, "Coulomb friction of a particle that slides on steel, at most the static one"
    ),
    "tangential_stiffness_ratio": ParameterRange(
        0.01, 2.0, 0.2, 1.0, "tangential over normal stiffness of all contacts"
    ),
    "long_term_damping": ParameterRange(0.0, 2.0, 0.0, 1.0, "damping coefficient of long-term contacts"),
}

PARAMETERS: Mapping[str, ParameterRange] = {**PAPER_PARAMETERS, **FURTHER_PARAMETERS}


def default_values() -> dict[str, float]:
    """What the paper's four are where a study says nothing of them: the middles of their ranges."""
    return {name: limit.middle for name, limit in PAPER_PARAMETERS.items()}


def _finite(field: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InvalidValue(field, value, "a finite number")
    return float(value)


@dataclass(frozen=True)
class Variable:
    """One searched parameter. `step` is the resolution designs are rounded to (None: none)."""

    name: str
    lower: float
    upper: float
    step: float | None = None

    def __post_init__(self) -> None:
        if self.name not in PARAMETERS:
            raise InvalidValue("variables.name", self.name, "one of " + ", ".join(PARAMETERS))
        field = f"variables.{self.name}"
        lower, upper = _finite(f"{field}.lower", self.lower), _finite(f"{field}.upper", self.upper)
        limit = PARAMETERS[self.name]
        if not limit.lower <= lower <= limit.upper:
            raise InvalidValue(f"{field}.lower", lower, f"{limit.lower:g} to {limit.upper:g}")
        if not limit.lower <= upper <= limit.upper:
            raise InvalidValue(f"{field}.upper", upper, f"{limit.lower:g} to {limit.upper:g}")
        if lower >= upper:
            raise InvalidValue(f"{field}.lower", lower, f"less than its upper bound {upper:g}")
        if self.step is not None:
            step = _finite(f"{field}.step", self.step)
            if not 0.0 < step <= upper - lower:
                raise InvalidValue(f"{field}.step", step, f"more than 0 and at most {upper - lower:g}")

    def snap(self, value: float) -> float:
        """The nearest allowed value: inside the bounds and on the step grid that starts at `lower`."""
        value = min(max(value, self.lower), self.upper)
        if self.step is not None:
            last = math.floor((self.upper - self.lower) / self.step + 1e-9)
            value = self.lower + min(round((value - self.lower) / self.step), last) * self.step
        return round(value, 12)


@dataclass(frozen=True)
class SearchSpace:
    """The box that a study searches; at least one variable, each name once."""

    variables: tuple[Variable, ...]

    def __post_init__(self) -> None:
        if not self.variables:
            raise InvalidValue("variables", [], "at least one variable")
        names = [v.name for v in self.variables]
        for name in names:
            if names.count(name) > 1:
                raise InvalidValue("variables.name", name, "each variable once")

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(v.name for v in self.variables)

    @property
    def dimension(self) -> int:
        return len(self.variables)

    def to_unit(self, x: Sequence[float]) -> tuple[float, ...]:
        return tuple((a - v.lower) / (v.upper - v.lower) for a, v in zip(x, self.variables, strict=True))

    def from_unit(self, u: Sequence[float]) -> tuple[float, ...]:
        """Physical values, snapped to the steps."""
        return tuple(
            v.snap(v.lower + a * (v.upper - v.lower)) for a, v in zip(u, self.variables, strict=True)
        )

    def as_dict(self, x: Sequence[float]) -> dict[str, float]:
        return dict(zip(self.names, x, strict=True))

    @property
    def hash(self) -> str:
        """sha256 of names, bounds and steps: two studies with the same hash search the same box."""
        spec = [[v.name, v.lower, v.upper, v.step] for v in self.variables]
        return hashlib.sha256(json.dumps(spec).encode()).hexdigest()


def default_space() -> SearchSpace:
    """The paper's four variables over their default ranges, to two decimals as the paper reports them."""
    return SearchSpace(
        tuple(Variable(name, r.default_lower, r.default_upper, 0.01) for name, r in PAPER_PARAMETERS.items())
    )

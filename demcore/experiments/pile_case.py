"""What a pile test is asked to do: material, rig, contact parameters, scale, seed; validated whole.

Importable without numba.
"""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import dataclass

from demcore.case import Interaction, MaterialTable, Stiffness
from demcore.errors import InputError
from demcore.material import Material, coarse_grain
from demcore.rig import Rig
from demcore.time_step import PRESETS, time_step


@dataclass(frozen=True)
class ContactParameters:
    """The paper's four variables (Table 5), dimensionless."""

    particle_particle_static_friction: float
    particle_wall_static_friction: float
    particle_particle_restitution: float
    rolling_resistance: float

    def __post_init__(self) -> None:
        for name, lower, upper in (
            ("particle_particle_static_friction", 0.0, 10.0),
            ("particle_wall_static_friction", 0.0, 10.0),
            ("particle_particle_restitution", 0.05, 1.0),
            ("rolling_resistance", 0.0, 10.0),
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and lower <= value <= upper):
                raise InputError(name, value, f"{lower:g} to {upper:g}")


@dataclass(frozen=True)
class PileTest:
    """One virtual experiment. `scale` multiplies the sizes, `fill_level` the filled height of the cylinder;
    `time_step` is a preset, `time_step_factor` shortens it after a blow-up."""

    material: Material
    rig: Rig
    parameters: ContactParameters
    scale: float = 1.0
    seed: int = 1
    fill_level: float = 1.0
    time_step: str = "fast"
    time_step_factor: float = 1.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.scale) and 0.1 <= self.scale <= 20.0):
            raise InputError("scale", self.scale, "0.1 to 20")
        if not (math.isfinite(self.fill_level) and 0.05 <= self.fill_level <= 1.0):
            raise InputError("fill_level", self.fill_level, "0.05 to 1")
        if self.time_step not in PRESETS:
            raise InputError("time_step", self.time_step, " or ".join(PRESETS))
        if not 0.0 < self.time_step_factor <= 1.0:
            raise InputError("time_step_factor", self.time_step_factor, "more than 0, at most 1")
        largest = self.material.sizes.largest * self.scale
        if largest > self.rig.cylinder_radius:
            raise InputError(
                "scale",
                self.scale,
                f"at most {self.rig.cylinder_radius / self.material.sizes.largest:.2g} for this rig, so that "
                "two of the largest particles fit across the cylinder",
            )

    @property
    def dt(self) -> float:
        """Time step, s, for the smallest particles and the smallest restitution in the test."""
        sizes = coarse_grain(self.material.sizes, self.scale)
        restitution = min(
            self.parameters.particle_particle_restitution, *(m.value for m in self.material.wall_restitution)
        )
        step = time_step(
            sizes.smallest,
            self.material.particle_density,
            self.material.youngs_modulus,
            restitution,
            self.time_step,
        )
        return step * self.time_step_factor

    @property
    def diameters_across_base(self) -> float:
        """Mean diameters along the base radius: below 12 the angle feels the particles (physics.md 4)."""
        return self.rig.base_radius / (self.material.sizes.mean_diameter * self.scale)

    def identity(self) -> str:
        """JSON of every input: a checkpoint of another test is not resumed."""
        return json.dumps(dataclasses.asdict(self), sort_keys=True)


def material_table(material: Material, parameters: ContactParameters) -> MaterialTable:
    """Row 0 the walls, one row of grains per wall restitution; dynamic friction is a share of static."""
    p, ratio = parameters, material.dynamic_friction_ratio
    grains = Interaction(
        p.particle_particle_restitution,
        p.particle_particle_static_friction,
        ratio * p.particle_particle_static_friction,
        p.rolling_resistance,
    )
    steel = [
        Interaction(
            mix.value,
            p.particle_wall_static_friction,
            ratio * p.particle_wall_static_friction,
            p.rolling_resistance,
        )
        for mix in material.wall_restitution
    ]
    rows = len(steel) + 1
    table = [[grains] * rows for _ in range(rows)]
    for k, contact in enumerate(steel, start=1):
        table[0][k] = table[k][0] = contact
    stiffness = Stiffness(material.youngs_modulus, material.poisson_ratio)
    return MaterialTable((stiffness,) * rows, tuple(tuple(row) for row in table))

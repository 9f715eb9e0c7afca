"""What a pile test is asked to do: material, rig, contact parameters, scale, seed; validated whole.

Importable without numba.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

from demcore.allowed import choice, natural, positive, within
from demcore.case import CONTACT_MODELS, Case, Dormancy, Numerics, RestCriterion
from demcore.charge import AT_REST, Fill
from demcore.errors import InputError
from demcore.experiments.contact_parameters import (
    ContactParameters,
    PairwiseParameters,
    Parameters,
    grains_of,
    interactions,
    numerics_of,
    with_surface,
)
from demcore.experiments.pile_setting import PileSetting
from demcore.geometry.walls import Wall
from demcore.material import Material
from demcore.region import Box, cylinder
from demcore.rig import Rig
from demcore.time_step import PRESETS

__all__ = ["ContactParameters", "PairwiseParameters", "PileTest"]

# Particles are forgotten so far below the base, m, and so many base radii from its axis.
FLOOR = -0.1
REACH = 4.0
# The cylinder's wall goes on upwards to hold a column of so little solid while it falls in.
LOOSEST = 0.15
# A bed that does not rest in so many seconds after it has fallen in, or after the cylinder went, gives no angle.
LONGEST_SETTLE = 4.0
LONGEST_DISCHARGE = 12.0
# Their places among the case's walls.
BASE, CYLINDER = 0, 1
# What the base is made of where its friction is not that of the cylinder.
BASE_SURFACE = "base"


@dataclass(frozen=True)
class PileTest:
    """One virtual experiment. `scale` multiplies the sizes, `fill_level` the filled height of the cylinder;
    `time_step` is a preset, `time_step_factor` shortens it after a blow-up. The cylinder vanishes at once, or
    rises at `lift_speed` (m/s). `numerics` hold but where `time_step` and `parameters` say otherwise. A mix takes
    one set of parameters for all its contacts, as the paper does, or one for each part (PairwiseParameters).
    `setting` is what departs from the ideal test."""

    material: Material
    rig: Rig
    parameters: Parameters
    scale: float = 1.0
    seed: int = 1
    fill_level: float = 1.0
    time_step: str = "fast"
    time_step_factor: float = 1.0
    lift_speed: float | None = None
    contact_model: str = "paper"
    numerics: Numerics = field(default_factory=Numerics)
    rest: RestCriterion = field(default_factory=RestCriterion)
    dormancy: Dormancy | None = None
    setting: PileSetting = field(default_factory=PileSetting)

    def __post_init__(self) -> None:
        within("scale", self.scale, 0.1, 20.0)
        within("fill_level", self.fill_level, 0.05, 1.0)
        choice("time_step", self.time_step, PRESETS)
        positive("time_step_factor", self.time_step_factor, "1 or less")
        within("time_step_factor", self.time_step_factor, 0.0, 1.0)
        choice("contact_model", self.contact_model, CONTACT_MODELS)
        natural("seed", self.seed)
        self._check_parameters()
        if self.lift_speed is not None:
            within("lift_speed", self.lift_speed, 0.001, 100.0, "m/s")
        room = self.rig.base_radius - self.rig.cylinder_radius
        offset = self.setting.cylinder_offset
        if math.hypot(*offset) > room:
            allowed = f"at most {room:.3g} m from the centre: the cylinder stands on the base"
            raise InputError("setting.cylinder_offset", offset, allowed)
        largest = self.material.sizes.largest * self.scale
        if largest > self.rig.cylinder_radius:
            raise InputError(
                "scale",
                self.scale,
                f"at most {self.rig.cylinder_radius / self.material.sizes.largest:.2g} for this rig, so that "
                "two of the largest particles fit across the cylinder",
            )

    def _check_parameters(self) -> None:
        """A number that the contact model does not have, or a set for a part that is not there, says nothing."""
        names = [grain.name for grain in self.material.grains]
        if isinstance(self.parameters, PairwiseParameters):
            for part in self.parameters.parts:
                choice("parameters.parts", part.material, names)
            grains_of(self.material, self.parameters)
        if self.contact_model != "paper":
            for name in ("tangential_stiffness_ratio", "long_term_damping"):
                if (value := getattr(self.parameters, name)) is not None:
                    raise InputError(name, value, f"none: {self.contact_model} has no such number")

    @property
    def dt(self) -> float:
        """Time step, s, for the stiffest, lightest pair in the test."""
        return self.case.dt

    @property
    def column_height(self) -> float:
        """m, that the loosest column of the fill may need."""
        solid = self.filled_kg / self.material.particle_density
        area = math.pi * self.rig.cylinder_radius**2
        return solid / (LOOSEST * area) + 4.0 * self.material.sizes.largest * self.scale

    @property
    def filled_kg(self) -> float:
        """Mass to fill: bulk density times the cylinder's volume times the fill level."""
        volume = math.pi * self.rig.cylinder_radius**2 * self.rig.cylinder_height * self.fill_level
        return self.material.bulk_density * volume

    @property
    def fall_seconds(self) -> float:
        """s, that the highest particle of the loosest column falls at most."""
        return math.sqrt(2.0 * self.column_height / 9.81)

    @property
    def lift_seconds(self) -> float:
        """s, until a lifted cylinder is clear of everything at the latest; 0 when it vanishes at once."""
        return 0.0 if self.lift_speed is None else self.column_height / self.lift_speed

    @property
    def longest_discharge(self) -> float:
        """s, that a pile may need to come to rest after the cylinder is clear of it."""
        return LONGEST_DISCHARGE + self.setting.shaking_seconds

    @cached_property
    def case(self) -> Case:
        """The test as a case: a base, a cylinder that goes on upwards, and the column to fall into it."""
        top, radius, reach = self.column_height, self.rig.cylinder_radius, REACH * self.rig.base_radius
        s, foot = self.setting, (*self.setting.cylinder_offset, 0.0)
        touching = interactions(self.material, self.parameters)
        own_base = s.base_friction_added != 0.0
        fill = cylinder(foot, radius, top)
        entering = (0.0, 0.0, -s.impact_speed) if s.drop_height else AT_REST
        case = Case(
            grains=grains_of(self.material.coarse_grained(self.scale), self.parameters),
            interactions=with_surface(touching, BASE_SURFACE, s.base_friction_added)
            if own_base
            else touching,
            duration=self.fall_seconds + LONGEST_SETTLE + self.lift_seconds + self.longest_discharge + 1.0,
            walls=(
                Wall("disc", radius=self.rig.base_radius, material=int(own_base)),
                Wall("cylinder", foot, radius=radius, length=top),
            ),
            fills=(Fill(fill, self.material.mix, self.filled_kg, velocity=entering),),
            water=None if s.water is None else s.water.at_scale(self.scale),
            air=None if s.air is None else s.air.at_scale(self.scale),
            domain=Box((-reach, -reach, FLOOR), (reach, reach, math.inf)),
            contact_model=self.contact_model,
            numerics=numerics_of(self.parameters, self.numerics, self.time_step),
            dormancy=self.dormancy,
            seed=self.seed,
        )
        if self.time_step_factor == 1.0:
            return case
        return replace(case, time_step=case.largest_time_step * self.time_step_factor)

    @property
    def diameters_across_base(self) -> float:
        """Mean diameters along the base radius: below 12 the angle feels the particles (physics.md 4)."""
        return self.rig.base_radius / (self.material.sizes.mean_diameter * self.scale)

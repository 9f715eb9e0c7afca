"""What a charge is asked to do: materials, plant, rate, scale, seed; validated whole. Importable without numba.

The feed onto the belt's tail is the charge: its mass is rate times duration. What the paper leaves open is a named
choice: the plant's own dimensions (data/plant.toml), and what happens to grains that a coarse scale makes larger
than a third of the narrowest passage (`largest_share`).
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib.resources import files
from typing import Any

from demcore.allowed import choice, natural, not_negative, positive, within
from demcore.case import Case, Numerics
from demcore.charge import Feed
from demcore.dormancy import Dormancy
from demcore.errors import InputError
from demcore.experiments.contact_parameters import (
    ContactParameters,
    PairwiseParameters,
    Parameters,
    PartParameters,
    grains_of,
    interactions,
    numerics_of,
    with_surface,
)
from demcore.geometry.walls import Wall
from demcore.interaction import Interactions
from demcore.material import Material, MixPart, SizeClass, SizeDistribution, cut_off, load_material
from demcore.plant.checks import check_mass, check_plant
from demcore.plant.clearance import check_inlet, feed_inlet
from demcore.plant.parts import Plant
from demcore.plant.surfaces import CONE, HOPPER, plant_walls
from demcore.region import Box
from demcore.surroundings import Air, Water
from demcore.time_step import PRESETS

# Seconds that the feed may lag behind its rate before the charge counts as one that the inlet cannot pass.
LONGEST_LAG = 20.0
# Grains that fell outside the hopper are forgotten so far below its seat, m; and so far around the plant.
BELOW, AROUND = 0.5, 1.0
# With the paper's soft 1e7 Pa a grain of 10 mm between steel and one of 80 mm that falls 2.5 m is squeezed through
# the sheet: its spring can store a tenth of the energy, at any scale. One in a hundred may.
MAY_SQUEEZE = 0.01
KG_S_PER_T_H = 1000.0 / 3600.0
LINER = "liner"


@dataclass(frozen=True)
class Charge:
    """A batch as the plant orders it: `rate` kg/s for `duration` s of a material or mix, with the numbers of its
    contacts: one set for all of them, as the paper has it, or one for each part (PairwiseParameters)."""

    name: str
    material: Material
    parameters: Parameters
    rate: float
    duration: float

    def __post_init__(self) -> None:
        positive("charge.rate", self.rate, "kg/s")
        positive("charge.duration", self.duration, "s")
        if isinstance(self.parameters, PairwiseParameters):
            names = [grain.name for grain in self.material.grains]
            for part in self.parameters.parts:
                choice("charge.parameters", part.material, names)
            grains_of(self.material, self.parameters)

    @property
    def mix(self) -> tuple[MixPart, ...]:
        """Its grains by name, with their shares of the mass."""
        return self.material.mix

    @property
    def mass(self) -> float:
        """kg."""
        return self.rate * self.duration


@dataclass(frozen=True)
class ChargeTest:
    """One virtual charge. `scale` multiplies the sizes; `largest_share` of the narrowest passage is the largest
    grain that is simulated, what is coarser joins the class below; `rest_seconds` after the last grain came.
    `time_step` is a preset, `time_step_factor` shortens it after a blow-up. Most of a charge is a bed at rest, so
    what does nothing is held (`dormancy`; None computes it all). `water` and `air` are those of the real grains;
    `liner_friction_added` is the static friction of the hopper's walls less that of all others."""

    charge: Charge
    plant: Plant
    scale: float = 4.0
    seed: int = 1
    rest_seconds: float = 10.0
    largest_share: float = 1.0 / 3.0
    time_step: str = "fast"
    time_step_factor: float = 1.0
    dormancy: Dormancy | None = field(default_factory=Dormancy)
    numerics: Numerics = field(default_factory=lambda: Numerics(may_squeeze=MAY_SQUEEZE))
    water: Water | None = None
    air: Air | None = None
    liner_friction_added: float = 0.0

    def __post_init__(self) -> None:
        within("scale", self.scale, 0.1, 20.0)
        within("largest_share", self.largest_share, 0.01, 1.0)
        not_negative("rest_seconds", self.rest_seconds, "s")
        choice("time_step", self.time_step, PRESETS)
        within("time_step_factor", self.time_step_factor, 0.01, 1.0)
        natural("seed", self.seed)
        within("liner_friction_added", self.liner_friction_added, -10.0, 10.0)
        check_plant(self.plant)
        check_mass(self.plant, self.charge.mass, self.charge.material.bulk_density)
        smallest = self.scale * self.charge.material.sizes.smallest
        if smallest >= self.largest_diameter:
            allowed = (
                f"less: the smallest grain would be {smallest:g} m, {self.largest_diameter:.3g} m may pass"
            )
            raise InputError("scale", self.scale, allowed)
        largest = max(g.sizes.largest for g in self.grains)
        check_inlet(self.plant, largest, feed_inlet(self.plant))

    @property
    def largest_diameter(self) -> float:
        """Of any grain that is simulated, m: `largest_share` of the narrowest of belt, hatch and inlet."""
        p = self.plant
        passage = min(p.belt.width, p.hatch.length, p.hatch.width)
        inlet = min(p.feeder.length, p.feeder.width)
        return min(self.largest_share * passage, 0.9 * inlet)

    @cached_property
    def grains(self) -> tuple[Material, ...]:
        """The materials at the scale of the simulation, cut off at the largest diameter."""
        coarse = grains_of(self.charge.material.coarse_grained(self.scale), self.charge.parameters)
        return tuple(replace(m, sizes=_no_larger(m.sizes, self.largest_diameter)) for m in coarse)

    @property
    def merged_share(self) -> float:
        """Of the charge's mass: what is coarser than the largest grain simulated, and was made smaller."""
        return sum(
            part.mass_share * _share_above(material, self.largest_diameter / self.scale)
            for part, material in zip(self.charge.mix, self.charge.material.grains, strict=True)
        )

    @property
    def expected_particles(self) -> int:
        """About how many grains the charge has."""
        return round(
            sum(
                part.mass_share
                * self.charge.mass
                / (m.particle_density * math.pi / 6.0 * m.sizes.number_mean_cube)
                for part, m in zip(self.charge.mix, self.grains, strict=True)
            )
        )

    @property
    def seconds(self) -> float:
        """Simulated time, s: the feed and the rest after it."""
        return self.charge.duration + self.rest_seconds

    @property
    def interactions(self) -> Interactions:
        """Every contact; unlike grains take the mean of their sets."""
        touching = interactions(self.charge.material, self.charge.parameters)
        added = self.liner_friction_added
        return with_surface(touching, LINER, added) if added != 0.0 else touching

    @cached_property
    def case(self) -> Case:
        """The charge as a case: the plant's walls and one feed onto the belt's tail."""
        belt, feeder = self.plant.belt, self.plant.feeder
        velocity = [
            belt.speed * r - feeder.fall_speed * n for r, n in zip(belt.running, belt.normal, strict=True)
        ]
        feed = Feed(
            feed_inlet(self.plant),
            self.charge.mix,
            rate=self.charge.rate,
            mass=self.charge.mass,
            velocity=(velocity[0], velocity[1], velocity[2]),
        )
        case = Case(
            grains=self.grains,
            interactions=self.interactions,
            duration=self.seconds + LONGEST_LAG,
            walls=self._walls,
            feeds=(feed,),
            domain=plant_domain(self.plant),
            rest=None,
            water=None if self.water is None else self.water.at_scale(self.scale),
            air=None if self.air is None else self.air.at_scale(self.scale),
            numerics=numerics_of(self.charge.parameters, self.numerics, self.time_step),
            dormancy=self.dormancy,
            seed=self.seed,
        )
        if self.time_step_factor == 1.0:
            return case
        return replace(case, time_step=case.largest_time_step * self.time_step_factor)

    @property
    def _walls(self) -> tuple[Wall, ...]:
        """The plant's; the hopper's own are lined where the liner is not as the rest."""
        walls = plant_walls(self.plant)
        if self.liner_friction_added == 0.0:
            return walls
        return tuple(replace(w, material=1) if w.name in (HOPPER, CONE) else w for w in walls)


def _no_larger(sizes: SizeDistribution, largest: float) -> SizeDistribution:
    """With what is coarser made as large as may be: it joins the class below, or is one where there is none."""
    if sizes.largest <= largest:
        return sizes
    if sizes.smallest >= largest:
        return SizeDistribution((SizeClass(largest, largest, 1.0),))
    return cut_off(sizes, 0.0, largest)


def _share_above(material: Material, diameter: float) -> float:
    """Mass share of what is coarser, uniform by mass inside a class."""
    share = 0.0
    for c in material.sizes.classes:
        if c.lower >= diameter:
            share += c.mass_share
        elif c.upper > diameter:
            share += c.mass_share * (c.upper - diameter) / (c.upper - c.lower)
    return share


def plant_domain(plant: Plant) -> Box:
    """A box around all walls; what falls beside the hopper leaves it through its bottom."""
    belt, rim = plant.belt, plant.hopper.rim_radius
    tail = belt.tangent_point[0] - belt.loaded_length
    beside = max(rim, belt.drum_along + belt.width, -belt.drum_along + belt.width) + AROUND
    return Box(
        (min(tail, -rim) - AROUND, -beside, -plant.hopper.seat_depth - BELOW),
        (rim + AROUND, beside, math.inf),
    )


def _table() -> dict[str, dict[str, Any]]:
    text = files("demcore").joinpath("data/charges.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def charge_names() -> tuple[str, ...]:
    return tuple(_table())


def load_charge(
    name: str, parameters: ContactParameters | Mapping[str, ContactParameters] | None = None
) -> Charge:
    """The charge shipped under `name`, with the paper's contact numbers unless `parameters` has others: one set
    for all contacts, or sets by material. Raises InputError for an unknown name."""
    table = _table()
    if name not in table:
        raise InputError("charge", name, "one of " + ", ".join(table))
    row = table[name]
    material, usual = load_material(row["material"]), ContactParameters(**row["parameters"])
    return Charge(
        name,
        material,
        _parameters(material, usual, parameters),
        row["rate_t_h"] * KG_S_PER_T_H,
        row["duration_s"],
    )


def _parameters(
    material: Material,
    usual: ContactParameters,
    given: ContactParameters | Mapping[str, ContactParameters] | None,
) -> Parameters:
    if given is None or isinstance(given, ContactParameters):
        return usual if given is None else given
    names = [grain.name for grain in material.grains]
    for name in given:
        choice("charge.parameters", name, names)
    if len(names) == 1:
        return given.get(names[0], usual)
    return PairwiseParameters(tuple(PartParameters(name, given.get(name, usual)) for name in names))

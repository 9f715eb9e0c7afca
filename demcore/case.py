"""Case: everything one simulation needs, as plain data. Frozen, validated whole, importable without numba."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

from demcore.allowed import Triple, choice, natural, not_negative, positive, vector, within
from demcore.charge import Feed, Fill
from demcore.dormancy import Dormancy
from demcore.errors import InputError
from demcore.geometry.walls import Wall
from demcore.interaction import (
    GrainRow,
    Interaction,
    Interactions,
    MaterialTable,
    Stiffness,
    compose_table,
    grain_rows,
    uniform_table,
)
from demcore.material import Material
from demcore.region import Box
from demcore.surroundings import Air, Water
from demcore.time_step import PRESETS, RAYLEIGH_SHARE, Body, hertz_time_step, pair_time_step, wall_time_step

__all__ = [
    "CONTACT_MODELS",
    "Case",
    "Dormancy",
    "Interaction",
    "MaterialTable",
    "Numerics",
    "RestCriterion",
    "Stiffness",
    "uniform_table",
]

CONTACT_MODELS = ("paper", "hertz_mindlin")
STANDARD_GRAVITY: Triple = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class Numerics:
    """Numbers that no public text fixes (physics.md sections 1 and 2, choices); recorded with every run.

    residual            paper: share of K_l s below which unloading never falls
    long_term_damping   paper: damping of aged contacts; None: the materials' value
    aged_after          paper: age at which that starts, in loading times
    stiffness_ratio     paper: tangential over normal stiffness
    creep_speed         m/s, below which a capped contact counts as sticking
    limit_force         Hertz-Mindlin: the damped normal force never pulls
    rolling             rolling resistance on or off
    restitution_exponent  paper: p of e(v) = e (v / 1 m/s)^-p; 0: restitution is the same at every speed
    time_step           preset of the time step: `fast` (loading limit) or `paper` (unloading limit too)
    may_squeeze         share of the particles that may be pressed through a wall, or past a neighbour's surface,
                        before the run counts as blown up: walls and grains are as soft as `youngs_modulus` says
    skin_share          of the smallest radius: how far the lists of neighbours reach beyond contact where all are
                        slow (fast ones are looked at from farther away); longer lists against rarer searches
    """

    residual: float = 0.001
    long_term_damping: float | None = None
    aged_after: float = 3.0
    stiffness_ratio: float = 1.0
    creep_speed: float = 1e-3
    limit_force: bool = False
    rolling: bool = True
    restitution_exponent: float = 0.0
    time_step: str = "fast"
    may_squeeze: float = 0.0
    skin_share: float = 0.5

    def __post_init__(self) -> None:
        within("numerics.may_squeeze", self.may_squeeze, 0.0, 0.1)
        within("numerics.skin_share", self.skin_share, 0.05, 10.0)
        within("numerics.residual", self.residual, 0.0, 0.1)
        if self.long_term_damping is not None:
            within("numerics.long_term_damping", self.long_term_damping, 0.0, 2.0)
        within("numerics.aged_after", self.aged_after, 1.0, 1e6, "loading times")
        within("numerics.stiffness_ratio", self.stiffness_ratio, 0.01, 2.0)
        not_negative("numerics.creep_speed", self.creep_speed, "m/s")
        within("numerics.restitution_exponent", self.restitution_exponent, 0.0, 1.0)
        choice("numerics.time_step", self.time_step, PRESETS)


@dataclass(frozen=True)
class RestCriterion:
    """A bed is at rest when its rms speed has stayed below `speed_share` sqrt(g d) for `duration` (s), d the
    mean diameter of what lies there (physics.md leaves it open; our choice, docs/decisions/0007)."""

    speed_share: float = 0.005
    duration: float = 0.1

    def __post_init__(self) -> None:
        positive("rest.speed_share", self.speed_share, "shares of sqrt(g d)")
        positive("rest.duration", self.duration, "s")


@dataclass(frozen=True)
class Case:
    """One simulation. Lengths m, times s, masses kg; `gravity` m/s2.

    grains          granular materials, already at the scale of the simulation
    interactions    what they do to each other and to the surfaces; Wall.material picks from interactions.surfaces
    fills, feeds    what is there at the start, and what comes in time; both name their materials
    duration        simulated time at which the run ends at the latest
    domain          particles that leave it are deleted and logged; None: everywhere
    rest            the run ends early when all has come and lies still; None: never early
    dormancy        particles that provably do nothing are held and not computed; None: all are, always
    water, air      None: dry grains, in vacuum
    time_step       None: the largest that is stable for the stiffest, lightest pair; above it is refused
    seed            of every random choice, beside each fill's and feed's own
    """

    grains: tuple[Material, ...]
    interactions: Interactions
    duration: float
    walls: tuple[Wall, ...] = ()
    fills: tuple[Fill, ...] = ()
    feeds: tuple[Feed, ...] = ()
    domain: Box | None = None
    rest: RestCriterion | None = field(default_factory=RestCriterion)
    dormancy: Dormancy | None = None
    contact_model: str = "paper"
    numerics: Numerics = field(default_factory=Numerics)
    gravity: Triple = STANDARD_GRAVITY
    water: Water | None = None
    air: Air | None = None
    time_step: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        names = [g.name for g in self.grains]
        if not names:
            raise InputError("grains", self.grains, "at least one material")
        for name in names:
            if names.count(name) > 1:
                raise InputError("grains", name, "each material's name once")
        choice("contact_model", self.contact_model, CONTACT_MODELS)
        positive("duration", self.duration, "s")
        vector("gravity", self.gravity, "m/s2")
        natural("seed", self.seed)
        if not self.fills and not self.feeds:
            raise InputError("fills", self.fills, "a fill or a feed: there is nothing to simulate")
        if self.rest is not None and not any(self.gravity):
            raise InputError("rest", self.rest, "None without gravity: rest is measured against sqrt(g d)")
        if self.dormancy is not None and not any(self.gravity):
            allowed = "None without gravity: forces are measured against the weight"
            raise InputError("dormancy", self.dormancy, allowed)
        self._check_names(names)
        self._check_room()
        self.table()
        exponent = self.numerics.restitution_exponent
        if exponent and self.contact_model != "paper":
            raise InputError("numerics.restitution_exponent", exponent, f"0: {self.contact_model} has none")
        if self.contact_model == "paper":
            within("long_term_damping", self.long_term_damping, 0.0, 2.0)
        self._check_time_step()

    def _check_names(self, names: list[str]) -> None:
        """Everything that is named or numbered must be there."""
        for fill in self.fills:
            for part in fill.mix:
                choice("fill.mix.material", part.material, names)
        for feed in self.feeds:
            for part in feed.mix:
                choice("feed.mix.material", part.material, names)
        surfaces = [s.name for s in self.interactions.surfaces]
        for wall in self.walls:
            if not 0 <= wall.material < len(surfaces):
                raise InputError(
                    "wall.material", wall.material, f"0 to {len(surfaces) - 1}, a surface of the case"
                )
        for contact in self.interactions.wall_contacts:
            choice("wall_contact.grain", contact.grain, names)
            choice("wall_contact.surface", contact.surface, surfaces)
        for pair in self.interactions.grain_contacts:
            choice("grain_contact.first", pair.first, names)
            choice("grain_contact.second", pair.second, names)

    def _check_room(self) -> None:
        """The largest particle must fit where it is put and where it may be."""
        largest = {g.name: g.sizes.largest for g in self.grains}
        for fill in self.fills:
            for part in fill.mix:
                if largest[part.material] > 2.0 * fill.region.largest_radius:
                    room = 2.0 * fill.region.largest_radius
                    raise InputError("fill.region", fill.region, _room(part.material, largest, room))
        for feed in self.feeds:
            for part in feed.mix:
                if largest[part.material] > 2.0 * feed.inlet.largest_radius:
                    room = 2.0 * feed.inlet.largest_radius
                    raise InputError("feed.inlet", feed.inlet, _room(part.material, largest, room))
            if feed.start >= self.duration:
                raise InputError("feed.start", feed.start, f"before the end at {self.duration:g} s")

    def _check_time_step(self) -> None:
        if self.time_step is not None:
            positive("time_step", self.time_step, "s")
            if self.time_step > self.largest_time_step:
                allowed = f"at most {self.largest_time_step:.6g} s, the limit of the {self._limit_name}"
                raise InputError("time_step", self.time_step, allowed)
        if self.dt > self.duration:
            raise InputError("duration", self.duration, f"at least one time step, {self.dt:.6g} s")

    @property
    def _limit_name(self) -> str:
        if self.contact_model == "hertz_mindlin":
            return f"smallest particles' Rayleigh time (share {RAYLEIGH_SHARE:g})"
        return f"stiffest, lightest pair with the preset {self.numerics.time_step!r}"

    @cached_property
    def largest_time_step(self) -> float:
        """s, over all pairs of materials, walls included (time_step.py)."""
        bodies = [
            Body(g.sizes.smallest, g.sizes.largest, g.particle_density, g.youngs_modulus, g.poisson_ratio)
            for g in self.grains
        ]
        if self.contact_model == "hertz_mindlin":
            return min(
                hertz_time_step(b.smallest, b.density, b.youngs_modulus, b.poisson_ratio) for b in bodies
            )
        preset = self.numerics.time_step
        steps = []
        for k, (grain, body) in enumerate(zip(self.grains, bodies, strict=True)):
            for other, b in zip(self.grains[k:], bodies[k:], strict=True):
                e = self.interactions.between(grain.name, other.name).restitution
                steps.append(pair_time_step(body, b, e, preset))
            for surface in (s for s in self.interactions.surfaces if s.name in self.touched):
                contact = self.interactions.at_wall(grain.name, surface.name)
                e = min(contact.interaction(mix.value).restitution for mix in grain.wall_restitution)
                steps.append(wall_time_step(body, surface.stiffness.youngs_modulus, e, preset))
        return min(steps)

    @property
    def dt(self) -> float:
        """The time step of the run, s."""
        return self.largest_time_step if self.time_step is None else self.time_step

    @property
    def rows(self) -> tuple[GrainRow, ...]:
        """Rows of the material tables that particles may have."""
        return grain_rows(self.grains, len(self.interactions.surfaces))

    def table(self) -> MaterialTable:
        """The material tables as the simulation reads them."""
        return compose_table(self.grains, self.interactions, self.touched)

    @property
    def touched(self) -> frozenset[str]:
        """Names of the surfaces that walls are made of."""
        return frozenset(self.interactions.surfaces[wall.material].name for wall in self.walls)

    @property
    def long_term_damping(self) -> float:
        """Of the paper's law: the numerics' value, else the materials'. Raises InputError where those differ."""
        if self.numerics.long_term_damping is not None:
            return self.numerics.long_term_damping
        values = {g.long_term_damping for g in self.grains}
        if len(values) > 1:
            allowed = "one value for all materials of a case, or numerics.long_term_damping"
            raise InputError("long_term_damping", sorted(values), allowed)
        return values.pop()

    @property
    def smallest_radius(self) -> float:
        """Of any particle that may come, m."""
        mixes = [*(fill.mix for fill in self.fills), *(feed.mix for feed in self.feeds)]
        used = {part.material for mix in mixes for part in mix}
        return min(g.sizes.smallest for g in self.grains if g.name in used) / 2.0

    @property
    def strength_of_gravity(self) -> float:
        """m/s2."""
        return math.hypot(*self.gravity)


def _room(material: str, largest: dict[str, float], room: float) -> str:
    return f"room for the largest particle of {material}, {largest[material]:g} m across; there is {room:g} m"

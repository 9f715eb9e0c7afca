"""The numbers that a calibration sets, and what they make of the contacts in a pile test.

One set of numbers for all contacts of a test, or one set for each part of a mix. The paper (section 2.2) has no
repose angle of its mix and gives all its contacts the plain mean of the two calibrated sets (Table 5, last
column); that is `averaged`. `PairwiseParameters` keeps each part's own set, and unlike parts meet by a rule.
Importable without numba.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace

from demcore.allowed import choice, shares, within
from demcore.case import Numerics
from demcore.errors import InputError
from demcore.interaction import (
    GrainContact,
    Interaction,
    Interactions,
    MaterialTable,
    Stiffness,
    Surface,
    WallContact,
    compose_table,
)
from demcore.material import Material

STEEL = "steel"

# The widest range of each; particle and wall restitution of 0 would make the unloading stiffness infinite.
LIMITS: Mapping[str, tuple[float, float, str]] = {
    "particle_particle_static_friction": (0.0, 10.0, ""),
    "particle_wall_static_friction": (0.0, 10.0, ""),
    "particle_particle_restitution": (0.05, 1.0, ""),
    "rolling_resistance": (0.0, 10.0, ""),
    "particle_wall_restitution": (0.05, 1.0, ""),
    "particle_wall_rolling_resistance": (0.0, 10.0, ""),
    "dynamic_friction_ratio": (0.0, 1.0, ""),
    "particle_particle_dynamic_friction": (0.0, 10.0, ""),
    "particle_wall_dynamic_friction": (0.0, 10.0, ""),
    "youngs_modulus_pa": (1e4, 1e12, "Pa"),
    "poisson_ratio": (0.0, 0.5, ""),
    "tangential_stiffness_ratio": (0.01, 2.0, ""),
    "long_term_damping": (0.0, 2.0, ""),
}


@dataclass(frozen=True)
class ContactParameters:
    """The paper's four variables (Table 5), and those that it assumes; dimensionless but for the modulus.

    What is None stays as it is without it: restitution at walls is the material's mix by mass share, rolling
    resistance at walls that between particles, dynamic friction, elasticity and damping the material's, tangential
    over normal stiffness that of the numerics. Dynamic friction is given as a ratio or by its values, not both.
    """

    particle_particle_static_friction: float
    particle_wall_static_friction: float
    particle_particle_restitution: float
    rolling_resistance: float
    particle_wall_restitution: float | None = None
    particle_wall_rolling_resistance: float | None = None
    dynamic_friction_ratio: float | None = None
    particle_particle_dynamic_friction: float | None = None
    particle_wall_dynamic_friction: float | None = None
    youngs_modulus_pa: float | None = None
    poisson_ratio: float | None = None
    tangential_stiffness_ratio: float | None = None
    long_term_damping: float | None = None

    def __post_init__(self) -> None:
        for name, (lower, upper, unit) in LIMITS.items():
            if (value := getattr(self, name)) is not None:
                within(name, value, lower, upper, unit)
        for pair in ("particle_particle", "particle_wall"):
            name = f"{pair}_dynamic_friction"
            if (dynamic := getattr(self, name)) is None:
                continue
            within(name, dynamic, 0.0, getattr(self, f"{pair}_static_friction"))
            if self.dynamic_friction_ratio is not None:
                raise InputError("dynamic_friction_ratio", self.dynamic_friction_ratio, f"none beside {name}")

    def grains(self, material: Material) -> Interaction:
        """How particles of the material touch each other."""
        static, given = self.particle_particle_static_friction, self.particle_particle_dynamic_friction
        dynamic = self._ratio(material) * static if given is None else given
        return Interaction(self.particle_particle_restitution, static, dynamic, self.rolling_resistance)

    def wall(self, material: Material, grain: str) -> WallContact:
        """How `grain`, the material or a part of it, touches steel."""
        static, given = self.particle_wall_static_friction, self.particle_wall_dynamic_friction
        dynamic = self._ratio(material) * static if given is None else given
        rolling = self.particle_wall_rolling_resistance
        rolling = self.rolling_resistance if rolling is None else rolling
        return WallContact(grain, STEEL, static, dynamic, rolling, self.particle_wall_restitution)

    def _ratio(self, material: Material) -> float:
        own = self.dynamic_friction_ratio
        return material.dynamic_friction_ratio if own is None else own

    def made_of(self, material: Material) -> Material:
        """The material with these elastic constants and damping, its own where they are None."""
        modulus, ratio, damping = self.youngs_modulus_pa, self.poisson_ratio, self.long_term_damping
        return replace(
            material,
            youngs_modulus=material.youngs_modulus if modulus is None else modulus,
            poisson_ratio=material.poisson_ratio if ratio is None else ratio,
            long_term_damping=material.long_term_damping if damping is None else damping,
        )


# How unlike parts of a mix meet, coefficient by coefficient: `mean` is physics.md's choice for rolling,
# `geometric` the other usual one, `minimum` lets the smoother partner decide.
MIXING_RULES: Mapping[str, Callable[[float, float], float]] = {
    "mean": lambda a, b: 0.5 * (a + b),
    "geometric": lambda a, b: math.sqrt(a * b),
    "minimum": min,
}


def unlike_interaction(rule: str, a: Interaction, b: Interaction) -> Interaction:
    """The contact of two unlike materials from those of each with itself. Raises InputError for the rule."""
    choice("unlike", rule, tuple(MIXING_RULES))
    combine = MIXING_RULES[rule]
    return Interaction(*(combine(getattr(a, f.name), getattr(b, f.name)) for f in fields(Interaction)))


@dataclass(frozen=True)
class PartParameters:
    """The parameters of one part of a mix."""

    material: str
    parameters: ContactParameters


@dataclass(frozen=True)
class PairwiseParameters:
    """Each part of a mix by its own set. Unlike parts meet as `pairs` says, else by the rule `unlike`."""

    parts: tuple[PartParameters, ...]
    unlike: str = "mean"
    pairs: tuple[GrainContact, ...] = ()

    def __post_init__(self) -> None:
        choice("unlike", self.unlike, tuple(MIXING_RULES))
        names = [part.material for part in self.parts]
        for name in names:
            if names.count(name) > 1:
                raise InputError("parameters.parts", name, "each part once")
        for pair in self.pairs:
            for name in (pair.first, pair.second):
                choice("parameters.pairs", name, tuple(names))
            if pair.first == pair.second:
                raise InputError(
                    "parameters.pairs", pair.first, "two unlike parts: alike ones have their own set"
                )
        if len({part.parameters.tangential_stiffness_ratio for part in self.parts}) > 1:
            values = [part.parameters.tangential_stiffness_ratio for part in self.parts]
            raise InputError("tangential_stiffness_ratio", values, "one value for all parts of a mix")

    def of(self, material: str) -> ContactParameters:
        """The set of one part. Raises InputError where there is none."""
        for part in self.parts:
            if part.material == material:
                return part.parameters
        raise InputError(
            "parameters.parts", [p.material for p in self.parts], f"a set for the part {material}"
        )

    @property
    def tangential_stiffness_ratio(self) -> float | None:
        """One for all parts."""
        return self.parts[0].parameters.tangential_stiffness_ratio if self.parts else None

    @property
    def long_term_damping(self) -> float | None:
        """Of the first part; a case refuses parts that differ."""
        return self.parts[0].parameters.long_term_damping if self.parts else None


Parameters = ContactParameters | PairwiseParameters


def parameters_of(parameters: Parameters, part: str) -> ContactParameters:
    """What holds for one part of a mix."""
    return parameters if isinstance(parameters, ContactParameters) else parameters.of(part)


def averaged(
    sets: Sequence[ContactParameters], mass_shares: Sequence[float] | None = None
) -> ContactParameters:
    """The mean of several sets: plain, as the paper's Table 5 does for its mix, or weighted by mass share.

    Raises InputError for shares that do not sum to 1, and for a number that only some of the sets give.
    """
    if not sets:
        raise InputError("parameters", [], "at least one set")
    weights = [1.0 / len(sets)] * len(sets) if mass_shares is None else list(mass_shares)
    if len(weights) != len(sets):
        raise InputError("mass_shares", weights, f"{len(sets)} shares, one for each set")
    shares("mass_shares", weights)
    means: dict[str, float | None] = {}
    for name in LIMITS:
        values = [getattr(one, name) for one in sets]
        given = [v for v in values if v is not None]
        if given and len(given) < len(values):
            raise InputError(name, values, "a value in every set, or in none")
        # Twelve digits: (.3 + .1) / 2 is .2, and is shown to people.
        means[name] = round(sum(w * v for w, v in zip(weights, given, strict=True)), 12) if given else None
    return ContactParameters(**means)  # type: ignore[arg-type]


def grains_of(material: Material, parameters: Parameters) -> tuple[Material, ...]:
    """The granular materials of a test at its own scale: the material, or each part of a mix."""
    return tuple(parameters_of(parameters, grain.name).made_of(grain) for grain in material.grains)


def numerics_of(parameters: Parameters, numerics: Numerics, time_step: str) -> Numerics:
    """The numerics of a test; what its parameters and its preset of the time step say goes before."""
    ratio, damping = parameters.tangential_stiffness_ratio, parameters.long_term_damping
    return replace(
        numerics,
        time_step=time_step,
        stiffness_ratio=numerics.stiffness_ratio if ratio is None else ratio,
        long_term_damping=numerics.long_term_damping if damping is None else damping,
    )


def interactions(material: Material, parameters: Parameters) -> Interactions:
    """Every contact of a test. Walls are of steel as stiff as the grains, the stiffest of a mix's."""
    grains = grains_of(material, parameters)
    if isinstance(parameters, ContactParameters):
        # One set for all: the mix's own dynamic friction ratio stands for both partners.
        common = parameters.grains(material)
        between = {(a.name, b.name): common for k, a in enumerate(grains) for b in grains[k:]}
        walls = tuple(parameters.wall(material, g.name) for g in grains)
    else:
        between = _pairwise(grains, parameters)
        walls = tuple(parameters.of(g.name).wall(g, g.name) for g in grains)
    stiffest = max(grains, key=lambda g: g.youngs_modulus)
    steel = Surface(STEEL, Stiffness(stiffest.youngs_modulus, stiffest.poisson_ratio))
    contacts = tuple(GrainContact(a, b, contact) for (a, b), contact in between.items())
    return Interactions(contacts, walls, (steel,))


def with_surface(touching: Interactions, name: str, added: float) -> Interactions:
    """The same with a second surface: steel with `added` to its static friction (never below 0), and the dynamic
    one in proportion."""
    own = tuple(replace(_rougher(contact, added), surface=name) for contact in touching.wall_contacts)
    surface = replace(touching.surfaces[0], name=name)
    return replace(
        touching, wall_contacts=touching.wall_contacts + own, surfaces=(*touching.surfaces, surface)
    )


def _rougher(contact: WallContact, added: float) -> WallContact:
    static = max(contact.static_friction + added, 0.0)
    # Grains that slide on the wall without friction have no ratio to keep.
    ratio = contact.dynamic_friction / contact.static_friction if contact.static_friction else 1.0
    return replace(contact, static_friction=static, dynamic_friction=ratio * static)


def _pairwise(
    grains: Sequence[Material], parameters: PairwiseParameters
) -> dict[tuple[str, str], Interaction]:
    own = {g.name: parameters.of(g.name).grains(g) for g in grains}
    given = {frozenset((pair.first, pair.second)): pair.interaction for pair in parameters.pairs}
    between = {(name, name): contact for name, contact in own.items()}
    for k, a in enumerate(grains):
        for b in grains[k + 1 :]:
            ruled = unlike_interaction(parameters.unlike, own[a.name], own[b.name])
            between[a.name, b.name] = given.get(frozenset((a.name, b.name)), ruled)
    return between


def material_table(material: Material, parameters: Parameters) -> MaterialTable:
    """Row 0 the walls, one row of grains per material and wall restitution."""
    return compose_table(grains_of(material, parameters), interactions(material, parameters), (STEEL,))

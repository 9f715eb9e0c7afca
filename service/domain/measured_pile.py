"""A measured condition as demcore's pile test: rig, grains, filled mass, how the cylinder went.

Screening is done with coarse piles (diagnosis.md, Budget): sizes are multiplied until the filled mass holds about
`grains` particles, never below the real size. Lengths m, masses kg, densities kg/m3.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping
from dataclasses import replace

from demcore.case import Numerics
from demcore.errors import InputError
from demcore.experiments import charge_effects, pile_effects
from demcore.experiments.contact_parameters import ContactParameters
from demcore.experiments.pile_case import PileTest
from demcore.experiments.pile_setting import PileSetting
from demcore.material import Material, SizeClass, SizeDistribution, load_material, material_names
from demcore.rig import Rig, load_rig
from service.domain.data_set.records import Condition, Psd
from service.domain.effects import Library, library
from service.domain.search_space import default_values

# The effects that a simulation has, by what is simulated.
SIMULATED: Mapping[str, Collection[str]] = {
    "pile": frozenset(pile_effects.EFFECTS),
    "charge": frozenset(charge_effects.EFFECTS),
}
# A stated size stands for a class of this half width, so that equal grains do not crystallise.
HALF_WIDTH = 1.1
# Less of the cylinder than this is no pile test.
LEAST_FILL = 0.05
# The library states the cohesion of a bulk of so much water; below it the bridges are fewer in proportion.
MOISTURE_OF_COHESION = 4.0
# Neighbour lists of so few grains are cheap to go through and dear to make: a run takes two thirds of the time.
FEW_GRAINS, LONG_SKIN = 1000, 2.0


def measured_pile(
    condition: Condition, parameters: ContactParameters, grains: int, contact_model: str, seed: int
) -> PileTest:
    """The ideal test of a condition. Raises demcore's InputError for what cannot be."""
    material, rig = material_of(condition), rig_of(condition)
    full = material.bulk_density * math.pi * rig.cylinder_radius**2 * rig.cylinder_height
    if not LEAST_FILL * full <= condition.mass_kg <= full:
        allowed = f"{LEAST_FILL * full:.4g} to {full:.4g} kg, what the cylinder holds at the bulk density"
        raise InputError("mass_kg", condition.mass_kg, allowed)
    numerics = Numerics(skin_share=LONG_SKIN) if grains <= FEW_GRAINS else Numerics()
    return PileTest(
        material,
        rig,
        parameters,
        numerics=numerics,
        scale=_scale(condition, material, grains),
        seed=seed,
        fill_level=condition.mass_kg / full,
        lift_speed=condition.lift_speed_m_s if condition.removal == "lift" else None,
        contact_model=contact_model,
        setting=PileSetting(drop_height=condition.drop_height_m),
    )


def cannot_simulate(
    condition: Condition, grains: int, contact_model: str, effects: Mapping[str, float] | None = None
) -> str | None:
    """Why demcore cannot make the test of a condition, with the amplitudes by effect key that a model version has;
    None where it can."""
    if condition.test != "pile":
        return "only pile tests are simulated by this model"
    if condition.material not in material_names():
        return f"{condition.material!r} is none of {', '.join(material_names())}"
    parameters = ContactParameters(**default_values())
    known = library()
    fewer = round(grains * (1.0 - known.self_test("self_particle_number").amplitude))
    acting = acting_effects(known, condition, effects or {})
    try:
        pile_effects.with_effects(measured_pile(condition, parameters, grains, contact_model, 0), acting)
    except InputError as error:
        return str(error)
    try:
        pile_effects.with_effects(measured_pile(condition, parameters, fewer, contact_model, 0), acting)
    except InputError as error:
        return (
            f"{error}, in the piles of {fewer} grains by which a diagnosis asks whether their number matters"
        )
    return None


def pile_scale(condition: Condition, grains: int) -> float:
    """How many times coarser than stated the grains of a condition are simulated."""
    return _scale(condition, material_of(condition), grains)


def acting_effects(known: Library, condition: Condition, amplitudes: Mapping[str, float]) -> dict[str, float]:
    """What a simulation makes of amplitudes by effect key in a condition: those in scope and not 0, cohesion in
    proportion to the water that there is."""
    in_scope = {key for e in known.effects if e.acts_on(condition) for key in e.keys}
    made = SIMULATED[condition.test]
    given = {k: a for k, a in amplitudes.items() if a and k in in_scope and k.partition("@")[0] in made}
    if "cohesion" in given:
        given["cohesion"] *= min(condition.moisture_percent / MOISTURE_OF_COHESION, 1.0)
    return given


def _scale(condition: Condition, material: Material, grains: int) -> float:
    """Rounded, so that near masses share their scale."""
    grain = material.particle_density * math.pi / 6.0 * material.sizes.number_mean_cube
    return max(round(math.cbrt(condition.mass_kg / grain / grains), 2), 1.0)


def rig_of(condition: Condition) -> Rig:
    """The material's rig with the condition's own dimensions. Raises InputError for a cylinder too wide."""
    rig = load_rig(condition.material)
    return replace(
        rig,
        base_diameter=condition.base_diameter_m or rig.base_diameter,
        cylinder_diameter=condition.cylinder_diameter_m or rig.cylinder_diameter,
        cylinder_height=condition.cylinder_height_m or rig.cylinder_height,
    )


def material_of(condition: Condition) -> Material:
    """The material with the condition's own sizes and particle density; it packs as the known one does."""
    material = load_material(condition.material)
    if condition.psd is not None:
        material = replace(material, sizes=size_classes(condition.psd))
    density = condition.particle_density_kg_m3
    if density is None:
        return material
    return replace(material, bulk_density=density * material.packing_fraction, grain_density=density)


def size_classes(psd: Psd) -> SizeDistribution:
    """Classes about the stated sizes (m, mass share), up to the geometric middle between two neighbours."""
    ordered = sorted((size, share) for size, share in psd if share > 0.0)
    total = math.fsum(share for _, share in ordered)
    sizes = [size for size, _ in ordered]
    between = [math.sqrt(a * b) for a, b in itertools.pairwise(sizes)]
    lower = [max(d / HALF_WIDTH, edge) for d, edge in zip(sizes, [0.0, *between], strict=True)]
    upper = [min(d * HALF_WIDTH, edge) for d, edge in zip(sizes, [*between, math.inf], strict=True)]
    shares = [share / total for _, share in ordered]
    return SizeDistribution(tuple(map(SizeClass, lower, upper, shares)))

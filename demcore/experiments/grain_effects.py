"""Physical extensions of grains, whatever is done with them: each with one amplitude, 0 changes nothing.

Their laws are those of the design's library of effects (diagnosis.md); a pile test and a charge take them alike.

id              amplitude a                          law
cohesion        Bond number of the median grain      bridges between wet grains, F = 4 pi R gamma (Fisher 1926);
                                                     gamma = a rho g r50^2 / 1.5
shape_roll      slope, 1                             mu_r(d) = mu_r (1 + a ln(d / 20 mm)), 0 or more
size_friction   slope, 1                             mu_s(d) = mu_s (1 + a ln(d / 20 mm)), 0 or more
wide_psd        added sd of ln d                     d' = d50 (d / d50)^(1 + a / s), s the sd of ln d by mass
density         share of the particle density        rho' = rho (1 + a), bulk density too
soft_stiffness  decades of Young's modulus           E' = E 10^a: how much stiffer the grains are than modelled
vel_restitution exponent p                           e(v) = e (v / 1 m/s)^-p (velocity_hysteretic_spring.py)
air_drag        multiple of the drag of still air    Schiller and Naumann 1935, Newton's .44 beyond Re = 1000
breakage        A, share                             fines t = A (1 - exp(-b g h)) of each fall h (the form of
                                                     t10 = A (1 - exp(-b E)), Narayanan and Whiten 1988)

Where an effect has nothing to act on the grains come back unchanged. Raises of every effect: InputError for a mix,
and where the amplitude leaves what the records allow.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from demcore.errors import InputError
from demcore.experiments.contact_parameters import (
    ContactParameters,
    PairwiseParameters,
    Parameters,
    PartParameters,
)
from demcore.experiments.pile_setting import STANDARD_G
from demcore.material import Material, MaterialPart, SizeClass, SizeDistribution, mixed
from demcore.surroundings import Air, Water

# Where the slopes with size cross the calibrated coefficient, m.
REFERENCE_DIAMETER = 0.020
# Inside such a ratio of diameters a coefficient that depends on the size is taken as constant.
FINEST_RATIO = 1.25
# b of the breakage law, kg/J: half of the most that can break does so after a fall of 3 m. Ours; coke and sinter
# scatter widely about it.
BREAKAGE_B = math.log(2.0) / (STANDARD_G * 3.0)


@dataclass(frozen=True)
class Batch:
    """Grains as an effect finds them: their real sizes, `water` and `air` of the real grains, the exponent of
    e(v), and the height that they `fall`, m."""

    material: Material
    parameters: Parameters
    restitution_exponent: float
    water: Water | None
    air: Air | None
    fall: float


GrainEffect = Callable[[Batch, float], Batch]


def _wide_psd(batch: Batch, a: float) -> Batch:
    material = _single(batch, "wide_psd")
    middle, spread = material.sizes.median_by_mass, _log_spread(material.sizes)
    exponent = 1.0 + a / spread if spread > 0.0 else math.nan
    if not exponent > 0.0:
        raise InputError("effect.wide_psd", a, f"more than -{spread:.3g}, and sizes that differ")

    def moved(d: float) -> float:
        return float(middle * (d / middle) ** exponent)

    classes = tuple(replace(c, lower=moved(c.lower), upper=moved(c.upper)) for c in material.sizes.classes)
    return replace(batch, material=replace(material, sizes=SizeDistribution(classes)))


def _log_spread(sizes: SizeDistribution) -> float:
    """Standard deviation of ln d by mass."""
    mass = [c.mass_share for c in sizes.classes]
    logs = [_mean_log(c) for c in sizes.classes]
    mean = math.fsum(m * x for m, (x, _) in zip(mass, logs, strict=True))
    square = math.fsum(m * (x2 - 2.0 * mean * x + mean**2) for m, (x, x2) in zip(mass, logs, strict=True))
    return math.sqrt(max(square, 0.0))


def _mean_log(c: SizeClass) -> tuple[float, float]:
    """Means of ln d and ln^2 d over a class whose mass is uniform in d: integrals of ln and ln^2."""
    a, b = c.lower, c.upper
    if b == a:
        return math.log(a), math.log(a) ** 2

    def first(d: float) -> float:
        return d * (math.log(d) - 1.0)

    def second(d: float) -> float:
        return d * (math.log(d) ** 2 - 2.0 * math.log(d) + 2.0)

    return (first(b) - first(a)) / (b - a), (second(b) - second(a)) / (b - a)


def _breakage(batch: Batch, a: float) -> Batch:
    """Fragments join the finest class: a tenth of the size would cost a thousand times the particles."""
    if not 0.0 <= a <= 1.0:
        raise InputError("effect.breakage", a, "0 to 1, the share that may break")
    material, fall = _single(batch, "breakage"), batch.fall
    broken = a * (1.0 - math.exp(-BREAKAGE_B * STANDARD_G * fall))
    finest, *others = material.sizes.classes
    if broken == 0.0 or not others:
        return batch
    kept = [replace(c, mass_share=c.mass_share * (1.0 - broken)) for c in others]
    fines = replace(finest, mass_share=1.0 - math.fsum(c.mass_share for c in kept))
    return replace(batch, material=replace(material, sizes=SizeDistribution((fines, *kept))))


def _density(batch: Batch, a: float) -> Batch:
    material = _single(batch, "density")
    if 1.0 + a <= 0.0:
        raise InputError("effect.density", a, "more than -1")
    grain = None if material.grain_density is None else material.grain_density * (1.0 + a)
    denser = replace(material, bulk_density=material.bulk_density * (1.0 + a), grain_density=grain)
    return replace(batch, material=denser)


def _soft_stiffness(batch: Batch, a: float) -> Batch:
    material, own = _single(batch, "soft_stiffness"), _one_set(batch, "soft_stiffness")
    modulus = material.youngs_modulus if own.youngs_modulus_pa is None else own.youngs_modulus_pa
    return replace(batch, parameters=replace(own, youngs_modulus_pa=modulus * 10.0**a))


def _shape_roll(batch: Batch, a: float) -> Batch:
    def by_size(own: ContactParameters, d: float) -> ContactParameters:
        return replace(own, rolling_resistance=own.rolling_resistance * _slope(a, d))

    return _by_size(batch, "shape_roll", by_size)


def _size_friction(batch: Batch, a: float) -> Batch:
    def by_size(own: ContactParameters, d: float) -> ContactParameters:
        dynamic, factor = own.particle_particle_dynamic_friction, _slope(a, d)
        return replace(
            own,
            particle_particle_static_friction=own.particle_particle_static_friction * factor,
            particle_particle_dynamic_friction=None if dynamic is None else dynamic * factor,
        )

    return _by_size(batch, "size_friction", by_size)


def _slope(a: float, diameter: float) -> float:
    return max(1.0 + a * math.log(diameter / REFERENCE_DIAMETER), 0.0)


def _by_size(
    batch: Batch, effect: str, change: Callable[[ContactParameters, float], ContactParameters]
) -> Batch:
    """One grain per narrow size class, each with its own parameters; unlike ones meet with the mean. After another
    such effect the grains are split already, and each part's own parameters change once more."""
    if isinstance(batch.parameters, PairwiseParameters) and _is_split(batch.material):
        sizes = {p.material.name: p.material.sizes.mean_diameter for p in batch.material.parts}
        changed = tuple(
            replace(p, parameters=change(p.parameters, sizes[p.material])) for p in batch.parameters.parts
        )
        return replace(batch, parameters=replace(batch.parameters, parts=changed))
    material, own = _single(batch, effect), _one_set(batch, effect)
    pieces = [piece for c in material.sizes.classes for piece in _cut(c)]
    if len(pieces) == 1:
        return batch
    parts, sets = [], []
    for k, c in enumerate(pieces, start=1):
        sizes_of = SizeDistribution((replace(c, mass_share=1.0),))
        grain = replace(material, name=f"{material.name} class {k}", sizes=sizes_of)
        parts.append(MaterialPart(grain, c.mass_share))
        sets.append(PartParameters(grain.name, change(own, sizes_of.mean_diameter)))
    split = _as_before(material, mixed(material.name, parts, material.constraints))
    return replace(batch, material=split, parameters=PairwiseParameters(tuple(sets)))


def _is_split(material: Material) -> bool:
    return bool(material.parts) and all(_part_of(material.name, p.material.name) for p in material.parts)


def _part_of(name: str, part: str) -> bool:
    return part.startswith(f"{name} class ")


def _as_before(material: Material, split: Material) -> Material:
    """A mix's means round; all parts are the same material, so its own numbers hold."""
    names = (
        *("bulk_density", "packing_fraction", "grain_density", "youngs_modulus", "poisson_ratio"),
        *("long_term_damping", "dynamic_friction_ratio", "wall_restitution", "target_deg", "window_deg"),
    )
    return replace(split, **{name: getattr(material, name) for name in names})


def _cut(c: SizeClass) -> list[SizeClass]:
    """Pieces of a class no wider than FINEST_RATIO; mass is uniform in the diameter inside a class."""
    count = max(math.ceil(math.log(c.upper / c.lower) / math.log(FINEST_RATIO) - 1e-9), 1)
    if count == 1:
        return [c]
    edges = [c.lower * (c.upper / c.lower) ** (k / count) for k in range(count)] + [c.upper]
    width = c.upper - c.lower
    return [SizeClass(a, b, c.mass_share * (b - a) / width) for a, b in itertools.pairwise(edges)]


def _cohesion(batch: Batch, a: float) -> Batch:
    if a < 0.0:
        raise InputError("effect.cohesion", a, "0 or more")
    radius = 0.5 * batch.material.sizes.median_by_mass
    return replace(batch, water=Water(a * batch.material.particle_density * STANDARD_G * radius**2 / 1.5))


def _vel_restitution(batch: Batch, a: float) -> Batch:
    return replace(batch, restitution_exponent=a)


def _air_drag(batch: Batch, a: float) -> Batch:
    still = Air()
    return replace(batch, air=Air(still.density * a, still.viscosity * a))


def _single(batch: Batch, effect: str) -> Material:
    if batch.material.parts:
        raise InputError(f"effect.{effect}", batch.material.name, "a material that is no mix")
    return batch.material


def _one_set(batch: Batch, effect: str) -> ContactParameters:
    if not isinstance(batch.parameters, ContactParameters):
        raise InputError(f"effect.{effect}", "pair-wise parameters", "one set of parameters for all contacts")
    return batch.parameters


# In the order in which several are applied: sizes, then densities and elasticity, then what splits by size.
GRAIN_EFFECTS: Mapping[str, GrainEffect] = {
    "wide_psd": _wide_psd,
    "breakage": _breakage,
    "density": _density,
    "soft_stiffness": _soft_stiffness,
    "shape_roll": _shape_roll,
    "size_friction": _size_friction,
    "cohesion": _cohesion,
    "vel_restitution": _vel_restitution,
    "air_drag": _air_drag,
}

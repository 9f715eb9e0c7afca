"""Physical extensions of the pile test, each with one amplitude; at amplitude 0 the test is unchanged.

The library of effects of the design (diagnosis.md), as far as a pile can show them and a simulation makes them:
faults of sensors change readings and belong to whoever reads; deflector and belt are the charge's. Where an effect
has nothing to act on (its scope), the test comes back unchanged too.

id              amplitude a                          law
cohesion        Bond number of the median grain      bridges between wet grains, F = 4 pi R gamma (Fisher 1926);
                                                     gamma = a rho g r50^2 / 1.5
shape_roll      slope, 1                             mu_r(d) = mu_r (1 + a ln(d / 20 mm)), 0 or more
size_friction   slope, 1                             mu_s(d) = mu_s (1 + a ln(d / 20 mm)), 0 or more
wide_psd        added sd of ln d                     d' = d50 (d / d50)^(1 + a / s), s the sd of ln d by mass
density         share of the particle density        rho' = rho (1 + a), bulk density too, at the same filled mass
soft_stiffness  decades of Young's modulus           E' = E 10^a: how much stiffer the grains are than modelled
vel_restitution exponent p                           e(v) = e (v / 1 m/s)^-p (velocity_hysteretic_spring.py)
lift_speed      ln of true over stated speed         of a cylinder that is lifted; one that vanishes has no speed
base_rough      added friction coefficient           mu' = mu + a between grains and base, 0 or more
feed_offcentre  m                                    the cylinder stands so far off the base's centre
air_drag        multiple of the drag of still air    Schiller and Naumann 1935, Newton's .44 beyond Re = 1000
breakage        A, share                             fines t = A (1 - exp(-b g h)) of each fall h (the form of
                                                     t10 = A (1 - exp(-b E)), Narayanan and Whiten 1988)
vibration       largest acceleration of the base, g  sine of 30 Hz for 1 s from the removal on

An effect with a direction takes its azimuth, degrees from x, behind an @: `feed_offcentre@90`.
Raises of every effect: InputError where the amplitude leaves what the test's records allow.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import replace

from demcore.allowed import choice, within
from demcore.errors import InputError
from demcore.experiments.contact_parameters import (
    ContactParameters,
    PairwiseParameters,
    PartParameters,
)
from demcore.experiments.pile_case import PileTest
from demcore.experiments.pile_setting import STANDARD_G, Vibration
from demcore.material import Material, MaterialPart, SizeClass, SizeDistribution, mixed
from demcore.surroundings import Air, Water

# Where the slopes with size cross the calibrated coefficient, m.
REFERENCE_DIAMETER = 0.020
# Inside such a ratio of diameters a coefficient that depends on the size is taken as constant.
FINEST_RATIO = 1.25
# b of the breakage law, kg/J: half of the most that can break does so after a fall of 3 m. Ours; coke and sinter
# scatter widely about it.
BREAKAGE_B = math.log(2.0) / (STANDARD_G * 3.0)

Effect = Callable[[PileTest, float], PileTest]


def with_effect(test: PileTest, effect: str, amplitude: float) -> PileTest:
    """The test with one effect of the library. Raises InputError for an unknown one and a wrong amplitude."""
    name, at, azimuth = effect.partition("@")
    choice("effect", name, tuple(EFFECTS))
    within(f"effect.{name}", amplitude, -1e3, 1e3)
    if amplitude == 0.0:
        return test
    if not at:
        return EFFECTS[name](test, amplitude)
    return _towards(test, name, amplitude, azimuth)


def with_effects(test: PileTest, amplitudes: Mapping[str, float]) -> PileTest:
    """The test with several, in the library's order: what changes the material comes before what reads it."""
    order = list(EFFECTS)
    for key in amplitudes:
        choice("effect", key.partition("@")[0], order)
    for key in sorted(amplitudes, key=lambda k: (order.index(k.partition("@")[0]), k)):
        test = with_effect(test, key, amplitudes[key])
    return test


def _towards(test: PileTest, name: str, amplitude: float, azimuth: str) -> PileTest:
    try:
        angle = math.radians(float(azimuth))
    except ValueError:
        angle = math.nan
    if name != "feed_offcentre" or not math.isfinite(angle):
        raise InputError("effect", f"{name}@{azimuth}", "feed_offcentre@AZIMUTH, degrees from x")
    return _off_centre(test, amplitude * math.cos(angle), amplitude * math.sin(angle))


def _wide_psd(test: PileTest, a: float) -> PileTest:
    material = _single(test, "wide_psd")
    middle, spread = material.sizes.median_by_mass, _log_spread(material.sizes)
    exponent = 1.0 + a / spread if spread > 0.0 else math.nan
    if not exponent > 0.0:
        raise InputError("effect.wide_psd", a, f"more than -{spread:.3g}, and sizes that differ")

    def moved(d: float) -> float:
        return float(middle * (d / middle) ** exponent)

    classes = tuple(replace(c, lower=moved(c.lower), upper=moved(c.upper)) for c in material.sizes.classes)
    return replace(test, material=replace(material, sizes=SizeDistribution(classes)))


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


def _breakage(test: PileTest, a: float) -> PileTest:
    """Fragments join the finest class: a tenth of the size would cost a thousand times the particles."""
    if not 0.0 <= a <= 1.0:
        raise InputError("effect.breakage", a, "0 to 1, the share that may break")
    material, fall = _single(test, "breakage"), test.setting.drop_height
    broken = a * (1.0 - math.exp(-BREAKAGE_B * STANDARD_G * fall))
    finest, *others = material.sizes.classes
    if broken == 0.0 or not others:
        return test
    kept = [replace(c, mass_share=c.mass_share * (1.0 - broken)) for c in others]
    fines = replace(finest, mass_share=1.0 - math.fsum(c.mass_share for c in kept))
    return replace(test, material=replace(material, sizes=SizeDistribution((fines, *kept))))


def _density(test: PileTest, a: float) -> PileTest:
    """The filled mass stays: the lab weighs what it fills in. Raises InputError where it does not fit."""
    material = _single(test, "density")
    if 1.0 + a <= 0.0:
        raise InputError("effect.density", a, "more than -1")
    grain = None if material.grain_density is None else material.grain_density * (1.0 + a)
    denser = replace(material, bulk_density=material.bulk_density * (1.0 + a), grain_density=grain)
    return replace(test, material=denser, fill_level=test.fill_level / (1.0 + a))


def _soft_stiffness(test: PileTest, a: float) -> PileTest:
    material, own = _single(test, "soft_stiffness"), _one_set(test, "soft_stiffness")
    modulus = material.youngs_modulus if own.youngs_modulus_pa is None else own.youngs_modulus_pa
    return replace(test, parameters=replace(own, youngs_modulus_pa=modulus * 10.0**a))


def _shape_roll(test: PileTest, a: float) -> PileTest:
    def by_size(own: ContactParameters, d: float) -> ContactParameters:
        return replace(own, rolling_resistance=own.rolling_resistance * _slope(a, d))

    return _by_size(test, "shape_roll", by_size)


def _size_friction(test: PileTest, a: float) -> PileTest:
    def by_size(own: ContactParameters, d: float) -> ContactParameters:
        dynamic, factor = own.particle_particle_dynamic_friction, _slope(a, d)
        return replace(
            own,
            particle_particle_static_friction=own.particle_particle_static_friction * factor,
            particle_particle_dynamic_friction=None if dynamic is None else dynamic * factor,
        )

    return _by_size(test, "size_friction", by_size)


def _slope(a: float, diameter: float) -> float:
    return max(1.0 + a * math.log(diameter / REFERENCE_DIAMETER), 0.0)


def _by_size(
    test: PileTest, effect: str, change: Callable[[ContactParameters, float], ContactParameters]
) -> PileTest:
    """One grain per narrow size class, each with its own parameters; unlike ones meet with the mean. After another
    such effect the grains are split already, and each part's own parameters change once more."""
    if isinstance(test.parameters, PairwiseParameters) and _is_split(test.material):
        sizes = {p.material.name: p.material.sizes.mean_diameter for p in test.material.parts}
        changed = tuple(
            replace(p, parameters=change(p.parameters, sizes[p.material])) for p in test.parameters.parts
        )
        return replace(test, parameters=replace(test.parameters, parts=changed))
    material, own = _single(test, effect), _one_set(test, effect)
    pieces = [piece for c in material.sizes.classes for piece in _cut(c)]
    if len(pieces) == 1:
        return test
    parts, sets = [], []
    for k, c in enumerate(pieces, start=1):
        sizes_of = SizeDistribution((replace(c, mass_share=1.0),))
        grain = replace(material, name=f"{material.name} class {k}", sizes=sizes_of)
        parts.append(MaterialPart(grain, c.mass_share))
        sets.append(PartParameters(grain.name, change(own, sizes_of.mean_diameter)))
    split = _as_before(material, mixed(material.name, parts, material.constraints))
    return replace(test, material=split, parameters=PairwiseParameters(tuple(sets)))


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


def _cohesion(test: PileTest, a: float) -> PileTest:
    if a < 0.0:
        raise InputError("effect.cohesion", a, "0 or more")
    radius = 0.5 * test.material.sizes.median_by_mass
    return _set(test, water=Water(a * test.material.particle_density * STANDARD_G * radius**2 / 1.5))


def _vel_restitution(test: PileTest, a: float) -> PileTest:
    return replace(test, numerics=replace(test.numerics, restitution_exponent=a))


def _lift_speed(test: PileTest, a: float) -> PileTest:
    return test if test.lift_speed is None else replace(test, lift_speed=test.lift_speed * math.exp(a))


def _base_rough(test: PileTest, a: float) -> PileTest:
    return _set(test, base_friction_added=test.setting.base_friction_added + a)


def _feed_offcentre(test: PileTest, a: float) -> PileTest:
    return _off_centre(test, a, 0.0)


def _off_centre(test: PileTest, along_x: float, along_y: float) -> PileTest:
    x, y = test.setting.cylinder_offset
    return _set(test, cylinder_offset=(x + along_x, y + along_y))


def _air_drag(test: PileTest, a: float) -> PileTest:
    still = Air()
    return _set(test, air=Air(still.density * a, still.viscosity * a))


def _vibration(test: PileTest, a: float) -> PileTest:
    return _set(test, vibration=Vibration(a))


def _set(test: PileTest, **changes: object) -> PileTest:
    return replace(test, setting=replace(test.setting, **changes))  # type: ignore[arg-type]


def _single(test: PileTest, effect: str) -> Material:
    if test.material.parts:
        raise InputError(f"effect.{effect}", test.material.name, "a material that is no mix")
    return test.material


def _one_set(test: PileTest, effect: str) -> ContactParameters:
    if not isinstance(test.parameters, ContactParameters):
        raise InputError(f"effect.{effect}", "pair-wise parameters", "one set of parameters for all contacts")
    return test.parameters


# In the order in which several are applied: sizes, then densities and elasticity, then what splits by size.
EFFECTS: Mapping[str, Effect] = {
    "wide_psd": _wide_psd,
    "breakage": _breakage,
    "density": _density,
    "soft_stiffness": _soft_stiffness,
    "shape_roll": _shape_roll,
    "size_friction": _size_friction,
    "cohesion": _cohesion,
    "vel_restitution": _vel_restitution,
    "lift_speed": _lift_speed,
    "base_rough": _base_rough,
    "feed_offcentre": _feed_offcentre,
    "air_drag": _air_drag,
    "vibration": _vibration,
}

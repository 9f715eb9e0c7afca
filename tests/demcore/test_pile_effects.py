"""The effects that the pile test makes: zero changes nothing, each changes what its law says."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from demcore.case_run import contact_model
from demcore.contact.liquid_bridge import LiquidBridge
from demcore.contact.still_air import StillAir
from demcore.contact.velocity_hysteretic_spring import VelocityHystereticSpring
from demcore.errors import InputError
from demcore.experiments.contact_parameters import ContactParameters, PairwiseParameters
from demcore.experiments.grain_effects import FINEST_RATIO
from demcore.experiments.pile_case import BASE, CYLINDER, PileTest
from demcore.experiments.pile_effects import EFFECTS, with_effect, with_effects
from demcore.experiments.pile_setting import PileSetting, Vibration
from demcore.experiments.pile_test import run_pile_test
from demcore.material import SizeClass, SizeDistribution, load_material
from demcore.rig import Rig, load_rig
from demcore.surroundings import Air, Water

PAPER = ContactParameters(0.40, 0.40, 0.20, 0.20)
COKE = PileTest(load_material("coke"), load_rig("coke"), PAPER, scale=3.0)
# Small enough to run in a second or two.
SMALL = PileTest(load_material("pellet"), Rig("small", 0.30, 0.15, 0.15, 24, 20), PAPER, scale=2.0, seed=3)
# A value that every effect can take.
AMPLITUDE = 0.1


@pytest.mark.parametrize("effect", EFFECTS)
def test_amplitude_zero_is_the_test_itself(effect):
    assert with_effect(COKE, effect, 0.0) is COKE


@pytest.mark.parametrize("effect", EFFECTS)
def test_every_effect_makes_another_case_that_can_run(effect):
    test = replace(COKE, setting=PileSetting(drop_height=2.0), lift_speed=0.1)
    changed = with_effect(test, effect, AMPLITUDE)
    assert changed != test
    assert changed.case.dt > 0.0
    assert changed.filled_kg == pytest.approx(test.filled_kg, rel=1e-9), "the lab weighs what it fills in"


@pytest.mark.parametrize("effect", EFFECTS)
@pytest.mark.parametrize("amplitude", [math.nan, math.inf, "1"])
def test_an_amplitude_is_a_finite_number(effect, amplitude):
    with pytest.raises(InputError, match=f"effect.{effect}"):
        with_effect(COKE, effect, amplitude)


def test_an_unknown_effect_is_named():
    with pytest.raises(InputError, match="ghost"):
        with_effects(COKE, {"ghost": 1.0})


def test_cohesion_keeps_the_bond_number_whatever_the_scale():
    """1.5 gamma / (rho g r^2); coke of 50 mm, its median, with water (.072 N/m) has about .02 (diagnosis.md)."""
    density = COKE.material.particle_density
    assert COKE.material.sizes.median_by_mass == pytest.approx(0.050, rel=0.01)
    for scale in (1.0, 3.0):
        case = with_effect(replace(COKE, scale=scale), "cohesion", 0.0208).case
        law = contact_model(case).cohesion
        assert isinstance(law, LiquidBridge)
        assert law.surface_tension == pytest.approx(0.072 * scale**2, rel=0.02)
        bond = 1.5 * law.surface_tension / (density * 9.81 * (0.025 * scale) ** 2)
        assert bond == pytest.approx(0.0208, rel=0.01)


def test_the_air_brakes_a_coarse_grain_as_the_real_one():
    """A 10 mm coke falling at 6 m/s feels .12 of its weight by .5 rho .44 pi r^2 v^2 / (m g), at any scale."""
    density, r, v = COKE.material.particle_density, 0.005, 6.0
    for scale in (1.0, 3.0):
        law = contact_model(with_effect(replace(COKE, scale=scale), "air_drag", 1.0).case).field
        assert isinstance(law, StillAir)
        big = r * scale
        reynolds = 2.0 * law.density * v * big / law.viscosity
        assert reynolds == pytest.approx(2.0 * 1.204 * v * r / 1.82e-5)
        drag = 0.5 * law.density * 0.44 * math.pi * big**2 * v**2
        weight = density * 4.0 / 3.0 * math.pi * big**3 * 9.81
        assert drag / weight == pytest.approx(3.0 * 0.44 * 1.204 * v**2 / (8.0 * density * r * 9.81))


@pytest.mark.parametrize("effect", ["shape_roll", "size_friction"])
def test_a_coefficient_follows_the_logarithm_of_the_size(effect):
    """mu (1 + a ln(d / 20 mm)) at the mean diameter of each narrow class; dynamic friction follows the static."""
    changed = with_effect(COKE, effect, 0.5)
    assert isinstance(changed.parameters, PairwiseParameters)
    field, base = ("rolling_resistance", 0.20) if effect == "shape_roll" else ("static_friction", 0.40)
    for part in changed.material.parts:
        sizes = part.material.sizes
        assert sizes.largest / sizes.smallest <= FINEST_RATIO + 1e-9
        contact = changed.case.interactions.between(part.material.name, part.material.name)
        expected = base * (1.0 + 0.5 * math.log(sizes.mean_diameter / 0.020))
        assert getattr(contact, field) == pytest.approx(expected)
        assert contact.dynamic_friction == pytest.approx(0.9 * contact.static_friction)
    split, whole = changed.material.sizes, COKE.material.sizes
    assert split.median_by_mass == pytest.approx(whole.median_by_mass)
    assert split.number_mean_cube == pytest.approx(whole.number_mean_cube)


def test_no_coefficient_falls_below_zero():
    """1 - 2 ln(90 / 20) is negative."""
    changed = with_effect(COKE, "shape_roll", -2.0)
    largest = changed.material.parts[-1].material.name
    assert changed.case.interactions.between(largest, largest).rolling_resistance == 0.0


def test_two_size_effects_at_once():
    both = with_effects(COKE, {"size_friction": 0.3, "shape_roll": -0.3})
    for part in both.material.parts:
        slope = 0.3 * math.log(part.material.sizes.mean_diameter / 0.020)
        contact = both.case.interactions.between(part.material.name, part.material.name)
        assert contact.static_friction == pytest.approx(0.40 * (1.0 + slope))
        assert contact.rolling_resistance == pytest.approx(0.20 * max(1.0 - slope, 0.0))


def test_wider_sizes_keep_the_median_and_gain_the_spread():
    """sd of ln d by mass, from many grains drawn by number and weighed."""

    def spread(test):
        d = test.material.sizes.sample(400_000, np.random.default_rng(1))
        logs, mass = np.log(d), d**3
        mean = np.average(logs, weights=mass)
        return math.sqrt(np.average((logs - mean) ** 2, weights=mass))

    wide = with_effect(COKE, "wide_psd", 0.15)
    assert spread(wide) - spread(COKE) == pytest.approx(0.15, abs=0.01)
    assert wide.material.sizes.median_by_mass == pytest.approx(COKE.material.sizes.median_by_mass, rel=0.02)


def test_equal_grains_cannot_be_spread():
    same = SizeDistribution((SizeClass(0.02, 0.02, 1.0),))
    with pytest.raises(InputError, match="wide_psd"):
        with_effect(replace(COKE, material=replace(COKE.material, sizes=same)), "wide_psd", 0.1)


def test_denser_grains_fill_less_of_the_cylinder():
    dense = with_effect(COKE, "density", 0.25)
    assert dense.material.particle_density == pytest.approx(1.25 * COKE.material.particle_density)
    assert dense.fill_level == pytest.approx(0.8)


def test_stiffer_grains_take_a_shorter_step():
    """The loading time goes with E^-1/2."""
    assert with_effect(COKE, "soft_stiffness", 2.0).dt == pytest.approx(COKE.dt / 10.0)


def test_breakage_needs_a_fall():
    assert with_effect(COKE, "breakage", 0.3) is COKE
    fallen = replace(COKE, setting=PileSetting(drop_height=3.0))
    fines = with_effect(fallen, "breakage", 0.3).material.sizes.classes[0].mass_share
    before = COKE.material.sizes.classes[0].mass_share
    assert fines == pytest.approx(before + (1.0 - before) * 0.15), "half of A after 3 m"


def test_restitution_that_falls_with_speed_is_another_law():
    law = contact_model(with_effect(COKE, "vel_restitution", 0.2).case).normal
    assert isinstance(law, VelocityHystereticSpring)
    assert (law.exponent, law.residual, law.damping) == (0.2, 0.001, 0.5)
    with pytest.raises(InputError, match="restitution_exponent"):
        assert with_effect(replace(COKE, contact_model="hertz_mindlin"), "vel_restitution", 0.2).case


def test_only_a_cylinder_that_is_lifted_has_a_speed():
    assert with_effect(COKE, "lift_speed", 0.7) is COKE
    lifted = with_effect(replace(COKE, lift_speed=0.1), "lift_speed", math.log(2.0))
    assert lifted.lift_speed == pytest.approx(0.2)


def test_the_base_alone_is_rougher():
    case = with_effect(COKE, "base_rough", 0.2).case
    surfaces = [case.interactions.surfaces[w.material].name for w in case.walls]
    assert (surfaces[BASE], surfaces[CYLINDER]) == ("base", "steel")
    base, steel = (case.interactions.at_wall("coke", name) for name in ("base", "steel"))
    assert (base.static_friction, base.dynamic_friction) == (pytest.approx(0.6), pytest.approx(0.54))
    assert steel.static_friction == pytest.approx(0.4)
    slippery = with_effect(COKE, "base_rough", -0.5).case
    assert slippery.interactions.at_wall("coke", "base").static_friction == 0.0


def test_a_direction_stands_behind_the_name():
    x, y = with_effects(COKE, {"feed_offcentre@30": 0.1}).setting.cylinder_offset
    assert (x, y) == (pytest.approx(0.0866, abs=1e-4), pytest.approx(0.05))
    for key in ("feed_offcentre@north", "cohesion@90"):
        with pytest.raises(InputError, match="AZIMUTH"):
            with_effect(COKE, key, 0.1)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"base_friction_added": math.inf}, "base_friction_added"),
        ({"drop_height": -1.0}, "drop_height"),
        ({"cylinder_offset": (math.nan, 0.0)}, "cylinder_offset"),
    ],
)
def test_a_setting_that_cannot_be(changes, field):
    with pytest.raises(InputError, match=field):
        PileSetting(**changes)


def test_what_surrounds_is_checked():
    for make, field in (
        (lambda: Water(-0.1), "surface_tension"),
        (lambda: Water(0.07, 2.0), "wetting"),
        (lambda: Air(0.0), "density"),
        (lambda: Air(1.2, math.nan), "viscosity"),
        (lambda: Vibration(6.0), "acceleration"),
        (lambda: Vibration(1.0, 0.0), "frequency"),
    ):
        with pytest.raises(InputError, match=field):
            make()


def test_the_cylinder_stands_on_the_base():
    with pytest.raises(InputError, match="cylinder_offset"):
        replace(COKE, setting=PileSetting(cylinder_offset=(0.15, 0.1)))


def test_the_base_ends_where_it_began():
    """Whole periods, and A w^2 = Gamma g."""
    shaking = Vibration(0.5, 30.0, 0.99)
    assert shaking.seconds * shaking.frequency == pytest.approx(30.0)
    rate = 2.0 * math.pi * shaking.frequency
    assert shaking.oscillation.amplitude[2] * rate**2 == pytest.approx(0.5 * 9.81)


def test_a_mix_has_no_size_of_its_own():
    mix = PileTest(load_material("sinter65_pellet35"), load_rig("sinter"), PAPER, scale=4.0)
    with pytest.raises(InputError, match="no mix"):
        with_effect(mix, "shape_roll", 0.5)


@pytest.fixture(scope="module")
def ideal():
    return run_pile_test(SMALL)


def test_a_heap_off_the_centre(ideal):
    """What falls off on the near side is lost, so the heap moves by less than the cylinder, and along x alone."""
    moved = run_pile_test(with_effect(SMALL, "feed_offcentre", 0.05))
    x, y = moved.numbers["heap_offset_x_m"], moved.numbers["heap_offset_y_m"]
    assert abs(ideal.numbers["heap_offset_x_m"]) < 0.008
    assert 0.008 < x < 0.05
    assert abs(y) < x


def test_a_slippery_base_keeps_less(ideal):
    slippery = run_pile_test(with_effect(SMALL, "base_rough", -0.2))
    assert slippery.numbers["mass_on_base_kg"] < 0.95 * ideal.numbers["mass_on_base_kg"]


def test_a_shaken_heap_is_flatter(ideal):
    # Ten seeds of this small heap read 12 to 21 degrees, and at 1.5 g hardly less; at 3 g six seeds read 2 to 6.
    shaken = run_pile_test(with_effect(SMALL, "vibration", 3.0))
    assert shaken.angle_deg < ideal.angle_deg - 4.0
    assert shaken.numbers["simulated_s"] - shaken.numbers["settled_at_s"] >= 1.0


def test_a_median_diameter_is_that_of_the_real_grains(ideal):
    lower, upper = SMALL.material.sizes.smallest, SMALL.material.sizes.largest
    assert lower <= ideal.numbers["d50_on_base_m"] <= upper


@pytest.mark.slow
def test_wet_grains_hold_each_other():
    """A heap of Bond number 2 keeps more on the base than a dry one."""
    seeds = range(3)
    dry = [run_pile_test(replace(SMALL, seed=s)).numbers["mass_on_base_kg"] for s in seeds]
    wet = [
        run_pile_test(with_effect(replace(SMALL, seed=s), "cohesion", 2.0)).numbers["mass_on_base_kg"]
        for s in seeds
    ]
    assert np.mean(wet) > np.mean(dry)

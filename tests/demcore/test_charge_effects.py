"""The effects that a charge makes: zero changes nothing, each changes what its law says and nothing else."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from demcore.case_run import contact_model
from demcore.contact.liquid_bridge import LiquidBridge
from demcore.contact.still_air import StillAir
from demcore.errors import InputError
from demcore.experiments import pile_effects
from demcore.experiments.charge_case import LINER, ChargeTest, load_charge
from demcore.experiments.charge_effects import EFFECTS, fall_height, with_effect, with_effects
from demcore.experiments.grain_effects import GRAIN_EFFECTS
from demcore.experiments.pile_case import PileTest
from demcore.material import load_material
from demcore.plant.plant_file import load_plant
from demcore.plant.surfaces import BELT, deflector_mesh
from demcore.rig import load_rig

COKE = ChargeTest(load_charge("coke"), load_plant(), scale=6.0)
# A value that every effect can take here.
AMPLITUDE = 0.02


@pytest.mark.parametrize("effect", EFFECTS)
def test_amplitude_zero_is_the_charge_itself(effect):
    assert with_effect(COKE, effect, 0.0) is COKE


@pytest.mark.parametrize("effect", EFFECTS)
def test_every_effect_makes_another_case_of_the_same_mass(effect):
    changed = with_effect(COKE, effect, AMPLITUDE)
    assert changed != COKE
    assert changed.case.dt > 0.0
    assert changed.charge.mass == COKE.charge.mass


@pytest.mark.parametrize("effect", EFFECTS)
@pytest.mark.parametrize("amplitude", [math.nan, math.inf, "1"])
def test_an_amplitude_is_a_finite_number(effect, amplitude):
    with pytest.raises(InputError, match=f"effect.{effect}"):
        with_effect(COKE, effect, amplitude)


@pytest.mark.parametrize("effect", ["ghost", "lift_speed", "vibration"])
def test_what_a_charge_has_not_is_named(effect):
    with pytest.raises(InputError, match=effect):
        with_effects(COKE, {effect: 1.0})


@pytest.mark.parametrize("effect", [e for e in GRAIN_EFFECTS if e != "breakage"])
def test_grains_are_changed_as_in_a_pile(effect):
    """One law, two experiments: materials, numbers of contacts, water, air and e(v) come out the same."""
    pile = PileTest(load_material("coke"), load_rig("coke"), COKE.charge.parameters, scale=3.0)
    lab, plant = pile_effects.with_effect(pile, effect, AMPLITUDE), with_effect(COKE, effect, AMPLITUDE)
    assert plant.charge.material == lab.material
    assert plant.charge.parameters == lab.parameters
    assert (plant.water, plant.air) == (lab.setting.water, lab.setting.air)
    assert plant.numerics.restitution_exponent == lab.numerics.restitution_exponent


def test_water_and_air_act_on_coarse_grains_as_on_real_ones():
    """The Bond number keeps, so gamma grows with scale^2; the drag's density grows with the scale (Reynolds)."""
    test = with_effects(COKE, {"cohesion": 0.0208, "air_drag": 1.0})
    laws = contact_model(test.case)
    assert isinstance(laws.cohesion, LiquidBridge)
    assert laws.cohesion.surface_tension == pytest.approx(0.072 * COKE.scale**2, rel=0.02)
    assert isinstance(laws.field, StillAir)
    assert laws.field.density == pytest.approx(1.204 * COKE.scale)


def test_breakage_makes_fines_by_the_fall_from_the_drum():
    """A fall of h breaks a (1 - 2^(-h / 3 m)): half of what can break after 3 m."""
    before, after = (t.charge.material.sizes.classes for t in (COKE, with_effect(COKE, "breakage", 0.2)))
    broken = 0.2 * (1.0 - 0.5 ** (fall_height(COKE.plant) / 3.0))
    assert after[-1].mass_share == pytest.approx(before[-1].mass_share * (1.0 - broken))
    assert after[0].mass_share > before[0].mass_share
    assert math.fsum(c.mass_share for c in after) == pytest.approx(1.0)


def test_the_liner_is_the_hopper_and_nothing_else():
    case = with_effect(COKE, "liner_wear", 0.1).case
    surfaces = [s.name for s in case.interactions.surfaces]
    own = {w.name for w in case.walls if surfaces[w.material] == LINER}
    assert own == {"hopper", "hopper cone"}
    friction = {
        surface: next(c for c in case.interactions.wall_contacts if c.surface == surface)
        for surface in surfaces
    }
    assert friction[LINER].static_friction == pytest.approx(friction["steel"].static_friction + 0.1)


def test_the_belt_runs_faster_and_beside_its_middle():
    def belt(test):
        return next(w for w in test.case.walls if w.name == BELT)

    plain, fast = belt(COKE), belt(with_effect(COKE, "belt_speed", 0.1))
    assert np.allclose(fast.surface_velocity, 1.1 * np.array(plain.surface_velocity))
    moved = belt(with_effect(COKE, "belt_track", 0.05))
    assert np.allclose(moved.mesh.vertices - plain.mesh.vertices, [0.0, 0.05, 0.0])


def test_the_deflector_moves_leans_and_wears():
    plain = deflector_mesh(COKE.plant.deflector).vertices

    def moved(effect, amplitude):
        return deflector_mesh(with_effect(COKE, effect, amplitude).plant.deflector).vertices - plain

    assert np.allclose(moved("deflector_shift", 0.04), [0.04, 0.0, 0.0])
    leant = with_effect(COKE, "deflector_tilt", 3.0).plant.deflector
    given = COKE.plant.deflector
    assert (leant.near_pitch_deg, leant.far_pitch_deg) == (
        given.near_pitch_deg + 3.0,
        given.far_pitch_deg - 3.0,
    )
    worn = moved("deflector_wear", 0.02)
    assert np.allclose(worn[:2], [0.0, 0.0, -0.02]), "the ridge is lower"
    assert given.near_pitch_deg == given.far_pitch_deg
    assert np.allclose(worn[2:], 0.0), "the lower edges stay"
    with pytest.raises(InputError, match="deflector_wear"):
        with_effect(COKE, "deflector_wear", -0.02)


def test_split_grains_that_are_too_large_for_the_plant_are_as_large_as_may_be():
    """At scale 10 the largest coke would be wider than a third of the hatch: its class keeps its friction."""
    coarse = with_effect(replace(COKE, scale=10.0), "size_friction", 0.1)
    assert max(g.sizes.largest for g in coarse.grains) <= coarse.largest_diameter
    own = {p.material: p.parameters.particle_particle_static_friction for p in coarse.charge.parameters.parts}
    assert len(set(own.values())) == len(coarse.grains) > 5
    assert coarse.case.dt > 0.0


def test_a_mix_is_refused_in_words():
    iron = ChargeTest(load_charge("iron"), load_plant(), scale=6.0)
    with pytest.raises(InputError, match="no mix"):
        with_effect(iron, "density", 0.1)
    assert with_effect(iron, "belt_speed", 0.1).plant.belt.speed > iron.plant.belt.speed

"""A charge as it is asked for: the paper's two charges, coarse scales, cost, and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from demcore.errors import InputError
from demcore.experiments.charge_case import ChargeTest, load_charge
from demcore.experiments.charge_cost import Cost, Rate
from demcore.experiments.charge_run import BELT, FLIGHT, HOPPER, LOST, places_of
from demcore.experiments.charge_test import estimate_cost, rate_case
from demcore.experiments.pile_case import ContactParameters
from demcore.plant.plant_file import load_plant

PLANT = load_plant()


def charge_test(name="coke", **changes):
    return replace(ChargeTest(load_charge(name), PLANT, scale=4.0), **changes)


def test_the_charges_are_the_papers():
    """Tables 5 and 8: 150 t/h for 72 s are 3 t; 321 t/h for 140 s are 12.48 t, which Table 8 rounds to 12.5."""
    coke, iron = load_charge("coke"), load_charge("iron")
    assert coke.mass == pytest.approx(3000.0)
    assert iron.mass == pytest.approx(12_483.3, abs=0.1)
    assert [(part.material, part.mass_share) for part in iron.mix] == [("sinter", 0.65), ("pellet", 0.35)]
    assert iron.material.bulk_density == pytest.approx(1936.0, abs=1.0)
    assert coke.parameters == ContactParameters(0.5, 0.8, 0.24, 0.48)
    assert iron.parameters == ContactParameters(0.4, 0.4, 0.3, 0.22)


@pytest.mark.parametrize(("name", "published"), [("coke", 280_000), ("iron", 1_400_000)])
def test_at_full_size_there_are_about_as_many_grains_as_in_the_paper(name, published):
    assert charge_test(name, scale=1.0).expected_particles == pytest.approx(published, rel=0.05)


def test_unlike_grains_touch_by_the_mixs_numbers():
    between = charge_test("iron").interactions.between("sinter", "pellet")
    assert (between.static_friction, between.restitution, between.rolling_resistance) == (0.4, 0.3, 0.22)
    own = ContactParameters(0.6, 0.4, 0.3, 0.2)
    changed = replace(charge_test("iron"), charge=load_charge("iron", {"pellet": own}))
    assert changed.interactions.between("sinter", "pellet").static_friction == pytest.approx(0.5)


def test_what_a_coarse_scale_makes_too_large_joins_the_class_below():
    """The belt is the narrowest passage, .8 m: a third of it is 267 mm, 66.7 mm of coke at scale 4."""
    fine, coarse = charge_test(scale=2.0), charge_test(scale=4.0)
    assert fine.merged_share == 0.0
    assert fine.grains[0].sizes.largest == pytest.approx(0.2)
    assert coarse.largest_diameter == pytest.approx(0.8 / 3.0)
    # 13.3 of the 20 mm of the class from 60 to 80 mm, which holds .22, and all of the next, .09.
    assert coarse.merged_share == pytest.approx(0.22 * (80.0 - 200.0 / 3.0) / 20.0 + 0.09)
    sizes = coarse.grains[0].sizes
    assert sizes.largest == pytest.approx(0.8 / 3.0)
    assert sum(c.mass_share for c in sizes.classes) == pytest.approx(1.0)
    assert sizes.classes[-1].mass_share == pytest.approx(0.31)


def test_the_case_feeds_the_charge_onto_the_belt():
    case = charge_test().case
    assert case.feeds[0].total == pytest.approx(3000.0)
    assert math.hypot(*case.feeds[0].velocity) == pytest.approx(math.hypot(1.79, 1.0))
    assert [wall.name for wall in case.walls][-2:] == ["belt", "drum"]
    assert case.duration > 82.0
    for wall in case.walls:
        if wall.mesh is not None:
            assert (wall.mesh.vertices > case.domain.lower).all()
            assert (wall.mesh.vertices < case.domain.upper).all()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"scale": 0.0}, "scale: got 0.0"),
        ({"scale": math.nan}, "scale"),
        ({"largest_share": 0.04}, "scale: got 4.0, allowed is less: the smallest grain would be 0.04 m"),
        ({"seed": -1}, "seed"),
        ({"rest_seconds": -1.0}, "rest_seconds"),
        ({"time_step": "quick"}, "time_step"),
    ],
)
def test_what_cannot_be_is_refused(changes, said):
    with pytest.raises(InputError, match=said):
        charge_test(**changes)


def test_a_charge_that_the_hopper_does_not_hold_is_refused():
    double = replace(load_charge("iron"), duration=500.0)
    with pytest.raises(InputError, match=r"charge.mass.*the hopper holds"):
        charge_test(charge=double)
    with pytest.raises(InputError, match=r"charge: got 'granite', allowed is one of coke, iron"):
        load_charge("granite")
    with pytest.raises(InputError, match=r"charge.parameters: got 'coke'"):
        load_charge("iron", {"coke": ContactParameters(0.5, 0.5, 0.5, 0.5)})


def test_an_inlet_inside_the_belt_is_refused_before_anything_runs():
    low = replace(PLANT, feeder=replace(PLANT.feeder, drop=0.05))
    with pytest.raises(InputError, match=r"feeder.drop"):
        charge_test(plant=low)


def test_the_cost_counts_grains_from_when_they_come():
    """Half of 72 s and all of 10 s. While the jet falls a search comes every hundred steps."""
    test = charge_test()
    cost = estimate_cost(test, Rate(1e6, 1e-3, 600))
    assert cost.steps == math.ceil(82.0 / test.case.dt)
    assert cost.particle_steps == pytest.approx(
        test.expected_particles * (36.0 + 10.0) / test.case.dt, rel=1e-6
    )
    assert cost.searches == pytest.approx(72.0 / (100.0 * test.case.dt), rel=0.01)
    assert cost.seconds == pytest.approx(
        cost.particle_steps / 1e6 + cost.searches * 1e-3 * cost.present / 600
    )
    few = estimate_cost(test, Rate(1e6, 1e-3, 60_000))
    assert few.seconds == pytest.approx(cost.particle_steps / 1e6 + cost.searches * 1e-3)
    assert "DAYS" not in cost.sentence()


def test_a_charge_that_would_take_days_says_so():
    """16 times an hour: half the size. Cost falls with the 4th power of the scale."""
    each = Cost(100, 1000, 50.0, 0, Rate(1e6, step_seconds=1e-4))
    assert each.seconds == pytest.approx(50.0 * 1000 / 1e6 + 1000 * 1e-4)
    assert "at 3.3e+05 a second, as measured here" in each.sentence()
    told = Cost(1_000_000, 3600, 256.0, 0, Rate(1.0, 0.0, 600)).sentence()
    assert "10.7 days" in told
    assert "THAT IS DAYS: 4 times as coarse takes an hour" in told


def test_the_bed_for_the_rate_is_small_whatever_the_charge():
    for name in ("coke", "iron"):
        case = rate_case(charge_test(name, scale=1.0))
        assert case.fills[0].mass < 0.01 * load_charge(name).mass
        assert not case.feeds


def at(x, y, z, radius=0.05):
    return int(places_of(np.array([[x, y, z]]), np.array([radius]), PLANT)[0])


def test_every_place_of_the_plant_has_its_name():
    tx, ty, tz = PLANT.belt.tangent_point
    angle = math.radians(20.0)
    over_drum = (-1.541 + 0.45 * math.sin(angle), 2.05 + 0.45 * math.cos(angle))
    assert at(tx - 2.0, ty, tz + 0.05) == BELT
    assert at(tx - 2.0, ty + 0.35, tz + 0.1) == BELT
    assert at(over_drum[0], ty, over_drum[1]) == BELT
    assert at(tx - 2.0, ty, tz - 0.5) == FLIGHT
    assert at(tx - 2.0, ty + 1.0, tz + 0.05) == FLIGHT
    assert at(-1.541 + 0.5, ty, 2.05) == FLIGHT
    assert at(-0.4, ty, 0.25) == FLIGHT
    assert at(-0.4, ty, 0.1) == HOPPER
    assert at(-0.4, 0.6, 0.1) == HOPPER
    assert at(0.5, 0.5, 0.29) == LOST
    assert at(0.5, 0.5, 0.8) == FLIGHT
    assert at(0.8, 0.2, -0.5) == HOPPER
    assert at(1.85, 0.0, -2.0) == LOST
    assert at(1.35, 0.0, -2.75) == LOST
    assert at(1.25, 0.0, -2.7) == HOPPER
    assert at(0.0, 0.5, -2.9) == LOST
    assert at(2.0, 0.0, -1.0) == LOST
    assert at(-3.0, ty, -1.0) == LOST

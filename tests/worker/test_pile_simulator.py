"""A condition of a data set becomes demcore's pile test; a runner that only looks stands in for the DEM."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from demcore.errors import InputError, NoResult
from demcore.experiments.contact_parameters import ContactParameters
from demcore.experiments.pile_case import PileTest
from service.domain.data_set.records import Condition
from service.domain.effects import library
from service.domain.measured_pile import measured_pile, size_classes
from service.domain.model_use import ModelUse
from worker.diagnosis.sensors import SENSOR_EFFECTS
from worker.diagnosis.simulator import Setting
from worker.pile_simulator import (
    NOTHING,
    OBSERVABLES,
    RINGS,
    SECTORS,
    PileReading,
    PileSimulator,
    polar_points,
    reading_as_record,
    reading_of,
    run_pile,
)

LAB = Condition("lab", "pile", "coke", mass_kg=300.0)
MIDDLE = (0.5, 0.5, 0.3, 0.3)
# Made from the cylinder's instant removal alone, of grains that do not fall: these have nothing to act on there.
SILENT_IN_THE_LAB = {"lift_speed", "vel_restitution", "breakage", "cohesion"}


class Looking:
    """Keeps the tests that it is asked for; every reading is a cone of slope .5 on a base of .75 m."""

    def __init__(self) -> None:
        self.tests: list[PileTest] = []

    def __call__(self, tests: Sequence[PileTest]) -> list[PileReading]:
        self.tests += tests
        _, r = polar_points(0.75)
        heights = np.maximum(0.5 * (0.75 - r), 0.0)
        return [
            PileReading(dict.fromkeys(OBSERVABLES, 1.0), heights, math.pi * 0.75**2 * 0.375 / 3.0)
            for _ in tests
        ]


def setting(seed: int = 1, **effects: float) -> Setting:
    return Setting(MIDDLE, tuple(effects.items()), seed)


def made(condition: Condition, *settings: Setting) -> list[PileTest]:
    runner = Looking()
    PileSimulator(runner).run(condition, settings or (setting(),))
    return runner.tests


def test_a_condition_says_what_was_done() -> None:
    done = replace(
        LAB, base_diameter_m=2.0, cylinder_diameter_m=1.0, cylinder_height_m=1.5, removal="lift",
        lift_speed_m_s=0.05, drop_height_m=1.5, particle_density_kg_m3=900.0, psd=((0.02, 0.3), (0.05, 0.7)),
    )  # fmt: skip
    (test,) = made(done)
    assert (test.rig.base_diameter, test.rig.cylinder_diameter, test.rig.cylinder_height) == (2.0, 1.0, 1.5)
    assert (test.lift_speed, test.setting.drop_height, test.seed) == (0.05, 1.5, 1)
    assert test.material.particle_density == pytest.approx(900.0)
    assert test.filled_kg == pytest.approx(300.0)
    assert [c.mass_share for c in test.material.sizes.classes] == pytest.approx([0.3, 0.7])
    assert test.parameters.particle_wall_static_friction == 0.5  # type: ignore[union-attr]


def test_a_pile_has_about_as_many_grains_as_asked_for() -> None:
    runner = Looking()
    PileSimulator(runner, grains=900).run(LAB, [setting()])
    (test,) = runner.tests
    grain = (
        test.material.particle_density * math.pi / 6.0 * test.material.sizes.number_mean_cube * test.scale**3
    )
    assert LAB.mass_kg / grain == pytest.approx(900, rel=0.03)


def test_no_grain_is_made_smaller_than_it_is() -> None:
    few = Condition("few", "pile", "coke", mass_kg=60.0, psd=((0.09, 1.0),))
    assert made(few)[0].scale == 1.0


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"test": "charge"}, "only pile tests"),
        ({"material": "sand"}, "none of coke, sinter, pellet"),
        ({"mass_kg": 5000.0}, "what the cylinder holds"),
        ({"cylinder_diameter_m": 3.0}, "cylinder_diameter"),
        ({"psd": ((1.5, 1.0),)}, "scale"),
    ],
)
def test_what_the_model_cannot_represent_is_told(changes: dict[str, object], why: str) -> None:
    condition = replace(LAB, **changes)  # type: ignore[arg-type]
    simulator = PileSimulator(Looking())
    told = simulator.cannot(condition)
    assert told is not None
    assert why in told
    with pytest.raises(ValueError, match="lab"):
        simulator.run(condition, [setting()])


def test_piles_that_would_be_too_coarse_with_fewer_grains_are_refused_before_they_are_made() -> None:
    """180 coke grains fit across the cylinder, the fifth fewer of the simulation's own check do not."""
    condition = replace(LAB, mass_kg=300.0)
    grains = next(
        n for n in range(100, 200) if measured(condition, n) and not measured(condition, round(0.8 * n))
    )
    told = PileSimulator(Looking(), grains=grains).cannot(condition)
    assert told is not None and "scale" in told and f"piles of {round(0.8 * grains)} grains" in told
    assert PileSimulator(Looking(), grains=round(grains / 0.8) + 1).cannot(condition) is None


def measured(condition: Condition, grains: int) -> bool:
    try:
        measured_pile(condition, ContactParameters(*MIDDLE), grains, "paper", 0)
    except InputError:
        return False
    return True


def test_an_effect_that_leaves_no_test_gives_a_run_without_a_pile() -> None:
    """Lumps wider than the cylinder, in one of three runs: the others keep their places."""
    runner = Looking()
    wide = library()["wide_psd"].highest
    told = PileSimulator(runner).run(LAB, [setting(1), setting(2, wide_psd=wide), setting(3)])
    assert [test.seed for test in runner.tests] == [1, 3]
    assert np.isfinite(told.values["repose_angle_deg"]).tolist() == [True, False, True]
    assert np.isnan(told.surfaces.h_m[1]).all() and np.isfinite(told.surfaces.h_m[2]).all()


def test_an_effect_out_of_its_scope_or_at_zero_is_the_baseline() -> None:
    baseline, *others = made(
        LAB,
        setting(),
        setting(lift_speed=0.5),
        setting(cohesion=0.3),
        setting(air_drag=2.0),
        setting(density=0.0),
    )
    assert all(test == baseline for test in others)


@pytest.mark.parametrize("effect", [e for e in library().effects if e.id not in SENSOR_EFFECTS])
def test_every_effect_of_the_library_that_acts_on_a_pile_is_made(effect) -> None:
    """On a wet pile whose grains fell and whose cylinder was lifted slowly."""
    condition = replace(LAB, moisture_percent=4.0, drop_height_m=2.0, removal="lift", cylinder_height_m=1.6)
    for key in effect.keys:
        baseline, changed = made(condition, setting(), setting(**{key: 0.1}))
        assert (changed != baseline) is effect.acts_on(condition)


def test_bridges_are_fewer_where_there_is_less_water() -> None:
    wet, moist = (made(replace(LAB, moisture_percent=m), setting(cohesion=0.4))[0] for m in (6.0, 1.0))
    assert wet.setting.water is not None
    assert moist.setting.water is not None
    assert wet.setting.water.surface_tension == pytest.approx(4.0 * moist.setting.water.surface_tension)


def test_faults_of_sensors_need_no_simulation_of_their_own() -> None:
    runner = Looking()
    simulator = PileSimulator(runner)
    faulty = setting(
        **{
            "sensor_offset": 0.01,
            "weigh_gain": 0.1,
            "sample_bias": -0.2,
            "sensor_tilt@0": 1.0,
            "sensor_tilt@90": 2.0,
        }
    )
    told = simulator.run(LAB, [setting(), faulty])
    healthy, misread = runner.tests
    assert healthy == misread
    values = {name: float(v[1]) for name, v in told.values.items()}
    assert values["apex_height_m"] == pytest.approx(1.01)
    assert values["mass_on_base_kg"] == pytest.approx(1.1)
    assert values["bulk_density_kg_m3"] == pytest.approx(1.1)
    assert values["d50_on_base_m"] == pytest.approx(0.8)
    # A cone of height H on R: plane of slope t moves the centre by t pi R^4/4 / (pi R^2 H/3) = 3 t R^2 / (4 H).
    assert values["heap_offset_x_m"] - 1.0 == pytest.approx(
        0.75 * 0.75**2 / 0.375 * math.tan(math.radians(1.0))
    )
    assert values["heap_offset_y_m"] - 1.0 == pytest.approx(
        0.75 * 0.75**2 / 0.375 * math.tan(math.radians(2.0))
    )
    assert told.surfaces is not None
    plane = told.surfaces.h_m[1] - told.surfaces.h_m[0] - 0.01
    x = told.surfaces.r_m * np.cos(np.radians(told.surfaces.theta_deg))
    y = told.surfaces.r_m * np.sin(np.radians(told.surfaces.theta_deg))
    expected = math.tan(math.radians(1.0)) * x + math.tan(math.radians(2.0)) * y
    assert plane == pytest.approx(expected)


def test_stated_sizes_become_classes_that_do_not_overlap() -> None:
    sizes = size_classes(((0.010, 0.2), (0.012, 0.5), (0.050, 0.3), (0.080, 0.0)))
    assert [c.mass_share for c in sizes.classes] == pytest.approx([0.2, 0.5, 0.3])
    first, second, third = sizes.classes
    assert first.upper == second.lower == pytest.approx(math.sqrt(0.010 * 0.012))
    assert (third.lower, third.upper) == (pytest.approx(0.050 / 1.1), pytest.approx(0.055))


def test_a_test_without_a_pile_tells_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(*_: object) -> None:
        raise NoResult("nothing lies on the base")

    monkeypatch.setattr("worker.pile_simulator.run_pile_test", nothing)
    assert run_pile(made(LAB)[0]) is NOTHING
    told = PileSimulator(lambda tests: [NOTHING for _ in tests]).run(LAB, [setting()])
    assert all(np.isnan(v).all() for v in told.values.values())
    assert told.surfaces is not None
    assert np.isnan(told.surfaces.h_m).all()
    assert told.surfaces.h_m.shape == (1, SECTORS * RINGS)


def test_a_reading_is_stored_and_read_exactly() -> None:
    (reading,) = Looking()(made(LAB))
    values = {**reading.values, "apex_height_m": math.nan, "mass_on_base_kg": 0.1 + 0.2}
    reading = PileReading(values, np.append(reading.heights[:-1], math.nan), 1.0 / 3.0)
    again = reading_of(json.loads(json.dumps(reading_as_record(reading), allow_nan=False)))
    assert again.values == pytest.approx(reading.values, nan_ok=True, rel=0.0, abs=0.0)
    assert np.array_equal(again.heights, reading.heights, equal_nan=True)
    assert again.volume == reading.volume


def test_the_simulation_s_own_errors_are_settings_of_the_same_pile() -> None:
    """Half the step, four times the modulus, two thirds of the scale, fewer grains."""
    baseline, step, stiff, fine, few = made(
        LAB,
        setting(),
        setting(self_time_step=math.log(2.0)),
        setting(self_stiffness=math.log10(4.0)),
        setting(self_coarse_graining=math.log(1.5)),
        setting(self_particle_number=0.2),
    )
    assert step.dt == pytest.approx(0.5 * baseline.dt)
    assert stiff.dt == pytest.approx(0.5 * baseline.dt)
    assert fine.scale == pytest.approx(baseline.scale / 1.5, rel=0.01)
    assert few.scale == pytest.approx(baseline.scale / 0.8 ** (1.0 / 3.0), rel=0.01)
    assert {t.id for t in library().self_tests} == {
        "self_time_step",
        "self_stiffness",
        "self_coarse_graining",
        "self_particle_number",
    }


WET = replace(LAB, moisture_percent=2.0)


def made_with(effects: dict[str, float], *settings: Setting, condition: Condition = WET) -> list[PileTest]:
    runner = Looking()
    PileSimulator(runner, model=ModelUse("baseline+x", effects=effects)).run(condition, settings)
    return runner.tests


@pytest.mark.parametrize(
    ("base", "added"),
    [
        ({"cohesion": 0.3}, {"cohesion": 0.2}),
        ({"density": 0.05}, {"density": -0.02}),
        ({"base_rough": 0.1}, {"cohesion": 0.2}),
        ({"feed_offcentre@0": 0.03, "feed_offcentre@90": -0.01}, {"feed_offcentre@90": 0.02}),
        ({"soft_stiffness": -0.2}, {"self_stiffness": 0.3, "soft_stiffness": 0.1}),
    ],
)
def test_an_effect_is_added_to_the_models_own(base: dict[str, float], added: dict[str, float]) -> None:
    """What the baseline is asked with the sum, a version is asked with the rest."""
    total = {key: base.get(key, 0.0) + added.get(key, 0.0) for key in {**base, **added}}
    assert made_with(base, setting(**added)) == made(WET, setting(**total))


def test_without_an_effect_of_a_setting_the_models_own_act() -> None:
    base = {"cohesion": 0.3, "density": 0.05}
    (own,) = made(WET, setting(**base))
    assert made_with(base, setting(), setting(cohesion=0.0), setting(lift_speed=0.5)) == [own] * 3
    # Dry grains have no bridges: there the version is the baseline with the other density.
    assert made_with(base, setting(), condition=LAB) == made(LAB, setting(density=0.05))


def test_without_a_model_the_same_is_asked_for_as_ever() -> None:
    assert made_with({}, setting(), setting(cohesion=0.3)) == made(WET, setting(), setting(cohesion=0.3))


def test_the_version_names_the_model_and_what_it_does() -> None:
    """Two projects may call different models alike, and their null runs must not meet."""
    plain = PileSimulator(Looking())
    uses = [ModelUse("baseline+cohesion", effects={"cohesion": a}) for a in (0.3, 0.4)]
    first, second = (PileSimulator(Looking(), model=use).version for use in uses)
    assert first != second
    assert first.startswith("baseline+cohesion:") and first.endswith("@" + plain.version)
    assert "@" not in plain.version


def test_what_a_model_leaves_no_pile_of_is_told() -> None:
    beyond = ModelUse("baseline+wide_psd", effects={"wide_psd": library()["wide_psd"].highest})
    told = PileSimulator(Looking(), model=beyond).cannot(LAB)
    assert told is not None and PileSimulator(Looking()).cannot(LAB) is None

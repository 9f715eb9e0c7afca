"""The pile test as a whole, on a rig small enough for a test: determinism, resume, cancel, refusals."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import h5py
import numpy as np
import pytest

from demcore import checkpoint
from demcore.errors import Cancelled, InputError, NoResult
from demcore.experiments.contact_parameters import ContactParameters, material_table
from demcore.experiments.mix_trials import pairwise_optimum
from demcore.experiments.pile_case import PileTest
from demcore.experiments.pile_test import run_pile_test
from demcore.material import load_material
from demcore.rig import Rig, load_rig
from demcore.run import Progress
from demcore.time_step import time_step

RIG = Rig("small", 0.30, 0.15, 0.15, 24, 20)
PAPER = ContactParameters(0.40, 0.40, 0.20, 0.20)


def small_test(**changes) -> PileTest:
    return replace(PileTest(load_material("pellet"), RIG, PAPER, scale=2.0, seed=3), **changes)


@pytest.fixture(scope="module")
def result():
    return run_pile_test(small_test())


def test_a_pile_is_measured_with_everything_that_went_in(result):
    numbers = result.summary()
    assert json.loads(json.dumps(numbers, allow_nan=False)) == numbers
    assert 10.0 < result.angle_deg < 40.0
    assert 0.0 < result.angle_sd_deg < 5.0
    # mass right to one particle: bulk density times the cylinder's volume
    volume = math.pi * 0.075**2 * 0.15
    assert numbers["mass_filled_kg"] == pytest.approx(2088.0 * volume, abs=3480.0 * math.pi / 6 * 0.044**3)
    assert 0.0 < numbers["mass_on_base_kg"] < numbers["mass_filled_kg"]
    assert np.hypot(result.positions[:, 0], result.positions[:, 1]).max() < RIG.base_radius
    assert len(result.h_m) == len(result.r_m)
    assert result.h_m[0] > result.h_m[-1]
    assert numbers["simulated_s"] > numbers["settled_at_s"] > 0.3


def test_what_a_calibration_may_compare_is_named_with_unit_and_error(result):
    numbers = result.summary()
    found = {o.name: o for o in result.observables()}
    assert found["angle_deg"].value == result.angle_deg
    assert found["angle_deg"].standard_error == result.angle_sd_deg
    assert found["mass_on_base_kg"][1:3] == (numbers["mass_on_base_kg"], "kg")
    assert found["mass_on_base_kg"].standard_error is None
    assert found["share_on_base"].value == pytest.approx(
        numbers["mass_on_base_kg"] / numbers["mass_filled_kg"]
    )
    assert 0.0 < found["discharge_t50_s"].value < found["discharge_t90_s"].value
    assert 0.0 < found["heap_top_m"].value < found["heap_height_m"].value
    # A settled bed of spheres: between loose and dense packing of grains of that density, walls included.
    assert 0.45 < found["filled_bulk_density_kg_m3"].value / 3480.0 < 0.66
    assert numbers["observables"]["heap_top_m"]["unit"] == "m"


def test_a_mix_piles_up_from_both_of_its_parts():
    mix = load_material("sinter65_pellet35")
    # Sinter is up to 80 mm: at half its size it fits the small cylinder.
    pile = run_pile_test(PileTest(mix, RIG, pairwise_optimum(mix, "mean"), scale=0.9, seed=3))
    mass = pile.radii**3 * np.where(pile.material_rows <= 2, 3105.0, 3480.0)
    share = mass[pile.material_rows <= 2].sum() / mass.sum()
    # What stays on the base is not what was filled, but near it.
    assert 0.5 < share < 0.8
    assert pile.summary()["parameters"]["unlike"] == "mean"


def test_the_same_seed_gives_the_same_bits_on_threads_too_and_another_seed_does_not(result):
    again = run_pile_test(small_test(), threads=2)
    assert again.positions.tobytes() == result.positions.tobytes()
    assert again.angle_deg == result.angle_deg
    assert run_pile_test(small_test(seed=4)).angle_deg != result.angle_deg


def test_a_killed_run_resumes_with_the_same_bits(result, tmp_path):
    path = tmp_path / "run.checkpoint"
    calls = 0

    def die_in_the_discharge(progress: Progress) -> bool:
        nonlocal calls
        calls += progress.phase == "discharge"
        if calls == 4:
            raise KeyboardInterrupt  # nothing in the run may catch it: it stands for a kill
        return True

    with pytest.raises(KeyboardInterrupt):
        run_pile_test(small_test(), die_in_the_discharge, checkpoint_path=path, checkpoint_seconds=0.0)
    seen = []
    resumed = run_pile_test(
        small_test(), lambda p: seen.append(p) or True, checkpoint_path=path, checkpoint_seconds=1e9
    )
    assert seen[0].phase == "discharge"
    assert resumed.positions.tobytes() == result.positions.tobytes()
    assert resumed.angle_deg == result.angle_deg
    assert resumed.numbers == result.numbers
    for run, name in ((result, "whole"), (resumed, "resumed")):
        run.write(tmp_path / name)
    assert (tmp_path / "resumed").read_bytes() == (tmp_path / "whole").read_bytes()


def test_a_run_that_is_stopped_in_order_saves_itself_first(result, tmp_path):
    path = tmp_path / "run.checkpoint"
    with pytest.raises(Cancelled):
        run_pile_test(small_test(), lambda p: p.time_s < 0.5, checkpoint_path=path)
    seen = []
    resumed = run_pile_test(small_test(), lambda p: seen.append(p.time_s) or True, checkpoint_path=path)
    assert seen[0] > 0.5
    assert resumed.positions.tobytes() == result.positions.tobytes()


def test_a_checkpoint_of_another_test_is_not_taken_over(tmp_path):
    path = tmp_path / "run.checkpoint"
    with pytest.raises(Cancelled):
        run_pile_test(small_test(), lambda p: p.time_s < 0.02, checkpoint_path=path, checkpoint_seconds=0.0)
    assert path.exists()
    started = []

    def first_only(progress: Progress) -> bool:
        started.append(progress.time_s)
        return False

    with pytest.raises(Cancelled), pytest.warns(checkpoint.CheckpointWarning, match="another case"):
        run_pile_test(small_test(seed=9), first_only, checkpoint_path=path)
    assert started[0] < 0.02


def test_progress_tells_where_a_run_is(result):
    reports = []
    run_pile_test(small_test(), lambda p: reports.append(p) or True)
    assert next(p.phase for p in reports) == "settle"
    assert reports[-1].phase == "discharge"
    fractions = [p.fraction for p in reports]
    assert fractions == sorted(fractions)
    assert 0.0 <= fractions[0] < fractions[-1] <= 1.0
    assert reports[-1].particles < reports[0].particles


def test_cancel_is_heard_at_the_next_report():
    with pytest.raises(Cancelled):
        run_pile_test(small_test(), lambda p: False)


def test_grains_without_friction_leave_no_pile():
    slippery = replace(PAPER, particle_particle_static_friction=0.0, particle_wall_static_friction=0.0)
    with pytest.raises(NoResult):
        run_pile_test(small_test(parameters=replace(slippery, rolling_resistance=0.0)))


def test_the_result_file_is_vtkhdf_and_describes_itself(result, tmp_path):
    path = tmp_path / "pile.vtkhdf"
    result.write(path)
    with h5py.File(path) as file:
        root = file["VTKHDF"]
        assert root.attrs["Type"] == b"PolyData"
        assert root["NumberOfPoints"][0] == len(result.radii)
        assert (root["Points"][:] == result.positions).all()
        assert (root["PointData"]["Radius"][:] == result.radii).all()
        assert root["Vertices"]["Offsets"].shape == (len(result.radii) + 1,)
        assert json.loads(file["Talus"].attrs["summary"])["angle_deg"] == result.angle_deg
    assert [p.name for p in tmp_path.iterdir()] == ["pile.vtkhdf"]


def test_dynamic_friction_is_the_published_share_and_the_wall_mixes_two_restitutions():
    table = material_table(load_material("pellet"), PAPER)
    assert table.interaction[1][2].dynamic_friction == pytest.approx(0.9 * 0.40)
    assert [table.interaction[0][k].restitution for k in (1, 2)] == [0.2, 0.5]
    assert table.interaction[1][1].restitution == 0.20


def test_the_time_step_is_the_published_formula():
    # physics.md section 1, by hand for two 20 mm pellets: m* = m/2, K = E d/2
    mass = 3480.0 * math.pi / 6 * 0.020**3 / 2
    quarter = math.pi / 2 * math.sqrt(mass / (1e7 * 0.020 / 2))
    assert small_test().dt == pytest.approx(quarter / 15)
    assert small_test(time_step="paper").dt == pytest.approx(quarter * 0.2 / 8)
    assert time_step(0.04, 3480.0, 1e7, 1.0) == pytest.approx(2 * time_step(0.02, 3480.0, 1e7, 1.0))


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"scale": math.nan}, "scale"),
        ({"scale": 9.0}, "scale"),  # two of the largest grains no longer fit across the cylinder
        ({"fill_level": 0.0}, "fill_level"),
        ({"time_step": "quick"}, "time_step"),
        ({"time_step_factor": 0.0}, "time_step_factor"),
    ],
)
def test_bad_input_is_refused(change, field):
    with pytest.raises(InputError) as caught:
        small_test(**change)
    assert caught.value.field == field


@pytest.mark.parametrize("value", [-0.1, math.nan, 1.4])
def test_a_restitution_outside_its_range_is_refused(value):
    with pytest.raises(InputError, match="particle_particle_restitution"):
        replace(PAPER, particle_particle_restitution=value)


def test_the_rigs_of_the_paper_take_their_materials():
    for name in ("coke", "sinter", "pellet"):
        assert PileTest(load_material(name), load_rig(name), PAPER).diameters_across_base > 12.0


def test_a_lifted_cylinder_leaves_a_pile_too():
    seen = []
    lifted = run_pile_test(small_test(lift_speed=0.25), lambda p: seen.append(p) or True)
    numbers = lifted.summary()
    assert numbers["lift_speed_m_s"] == 0.25
    assert 10.0 < lifted.angle_deg < 40.0
    # The cylinder is in the way until its lower end has passed the highest grain.
    discharge = numbers["simulated_s"] - numbers["settled_at_s"]
    assert discharge > numbers["apex_height_m"] / 0.25
    assert seen[-1].phase == "discharge"
    with pytest.raises(InputError) as caught:
        small_test(lift_speed=0.0)
    assert caught.value.field == "lift_speed"

"""Dormant particles: who falls dormant, what wakes whom, and that nothing else comes out than without."""

from __future__ import annotations

import argparse
import functools
from dataclasses import replace

import numpy as np
import pytest

from demcore import checkpoint
from demcore.case import Dormancy
from demcore.commands import pile
from demcore.dormant import AWAKE
from demcore.errors import BlowUp, Cancelled, InputError
from demcore.forces import touching_contacts
from demcore.geometry.walls import Wall
from demcore.particles import spheres
from demcore.run import simulate
from tests.demcore.builders import bed, by_number
from tests.demcore.cases import a_case, a_fill

OPTION = Dormancy()
SMALLEST = 0.005
WEIGHT = 9.81


@functools.cache
def settled_numbers():
    """What a settled bed of 300 with most of its particles dormant keeps, as a checkpoint would."""
    s = bed(300, dormancy=OPTION)
    s.advance(int(0.9 / s.dt))
    return s.stored()


def settled(dormancy=OPTION, **options):
    """That bed; without the option everybody is awake."""
    s = bed(300, dormancy=dormancy, **options)
    numbers, arrays = settled_numbers()
    s.restore(numbers, {name: array.copy() for name, array in arrays.items()})
    if dormancy is None:
        s.wake_all()
    return s


def drop(s, speed=1.0, radius=0.012):
    """A sphere over the middle of the bed, coming down; its number."""
    state = s.particles.state
    top = state[np.hypot(state[:, 0], state[:, 1]) < 0.03]
    place = [0.0, 0.0, float((top[:, 2] + top[:, 3]).max()) + radius + 0.001]
    s.add(spheres(np.array([place]), np.array([radius]), 2500.0, velocity=np.array([[0.0, 0.0, -speed]])))
    return s.next_number - 1


def test_a_settled_bed_falls_dormant_and_its_walls_carry_its_weight():
    s = settled()
    assert s.dormant_count > 0.8 * s.count
    held = s.dormant.state != AWAKE
    assert not s.particles.state[held, 4:7].any()
    assert not s.particles.state[held, 8:11].any()
    # Each is out of balance by less than a share of its weight, and errors of many cancel.
    load = s.near_walls.push.sum(axis=0)[2]
    assert load == pytest.approx(s.mass * WEIGHT, rel=OPTION.force_share / 2)
    # Contacts of two dormant ones are there, listed as closed, and not computed.
    owner, partner, _ = touching_contacts(s.neighbours)
    still = held[owner] & held[partner]
    assert still.sum() > 0.6 * len(owner)
    lists = s.neighbours
    histories = lists.history.copy()
    s.advance(10)
    if s.neighbours is lists:
        changed = (histories != lists.history).reshape(len(lists.lively), -1).any(axis=1)
        assert changed.sum() < 0.5 * len(lists.lively)


def test_a_dormant_bed_is_where_the_same_bed_would_have_stayed():
    s, free = settled(), settled(None)
    before = by_number(s)
    for run in (s, free):
        run.advance(int(0.2 / run.dt))
    moved = np.abs(by_number(s)[:, :3] - by_number(free)[:, :3]).max(axis=1)
    assert np.median(moved) < 1e-3 * SMALLEST
    assert np.quantile(moved, 0.95) < 0.02 * SMALLEST
    assert np.abs(by_number(s)[:, :3] - before[:, :3]).max() < SMALLEST


def test_a_sphere_that_falls_on_a_dormant_bed_wakes_it_and_sinks_in_as_without():
    depth = []
    for option in (OPTION, None):
        s = settled(option)
        asleep = s.dormant.state.copy(), s.particles.number.copy()
        name = drop(s)
        start = by_number(s)[name, 2]
        lowest = start
        for _ in range(40):
            s.advance(int(0.001 / s.dt))
            lowest = min(lowest, by_number(s)[name, 2])
        depth.append(start - lowest)
        if option is not None:
            woken = set(asleep[1][asleep[0] != AWAKE]) - set(s.particles.number[s.dormant.state != AWAKE])
            assert len(woken) >= 3
            place = s.particles.state[np.isin(s.particles.number, list(woken)), :3]
            middle = by_number(s)[name, :3]
            # Those below it wake first.
            assert np.linalg.norm(place - middle, axis=1).min() < 0.03
    assert depth[0] == pytest.approx(depth[1], rel=0.1)


def test_a_particle_that_leaves_wakes_who_leaned_on_it():
    # A ball on a ball in a narrow tube: the lower one is taken away at a search, as the domain takes one.
    s = bed(1, walls=[Wall("plane"), Wall("cylinder", radius=0.0106, length=1.0)], dormancy=OPTION)
    stack = spheres(np.array([[0.0, 0.0, 0.01], [0.0005, 0.0, 0.0299]]), np.full(2, 0.01), 2500.0)
    s.particles, s.next_number = stack, 2
    s.wake_all()
    s.advance(int(0.5 / s.dt))
    assert s.dormant_count == 2
    lower = int(s.particles.number[s.particles.state[:, 2].argmin()])
    s.domain = None
    s.particles.state[s.particles.number == lower, 2] = -1.0
    s.floor, s.stale = -0.5, True
    s.advance(int(0.05 / s.dt))
    assert s.count == 1
    assert s.particles.state[0, 2] < 0.025


def a_column(count):
    """Spheres of 10 mm on top of each other, exactly, on a plane: nothing turns them aside."""
    s = bed(1, walls=[Wall("plane")], dormancy=Dormancy(force_share=0.01))
    heights = 0.01 + 0.02 * np.arange(count)
    s.particles = spheres(np.column_stack([np.zeros((count, 2)), heights]), np.full(count, 0.01), 2500.0)
    s.next_number = count
    s.wake_all()
    s.advance(int(3.0 / s.dt))
    assert s.dormant_count == count
    return s, float(s.particles.state[0, 7]) * WEIGHT


def push_down(s, name, force):
    """One step in which the sphere above presses the named one by so much more."""
    row = int(np.flatnonzero(s.particles.number == name)[0])
    s.dormant.frozen[row, 2] -= force
    s.advance(1)
    return bool(s.dormant.state[s.particles.number == name][0] == AWAKE)


def test_a_load_is_what_goes_through_a_particle():
    # The k-th from the top is pressed by k - 1 weights from above and by k from below: half of the sum is k - 1/2.
    s, weight = a_column(8)
    order = np.argsort(-s.particles.state[:, 2])
    expected = (np.arange(8) + 0.5) * weight
    assert s.dormant.load[order] == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(("name", "carries"), [(7, 1.0), (6, 1.5), (1, 6.5), (0, 7.5)])
def test_what_carries_more_is_woken_by_more(name, carries):
    # Its own weight at least, then what goes through it (above).
    for share, woke in ((0.8, False), (1.2, True)):
        s, weight = a_column(8)
        assert push_down(s, name, share * OPTION.wake_share * carries * weight) is woke


@pytest.mark.parametrize("change", ["cylinder", "floor"])
def test_without_its_wall_a_dormant_bed_runs_away(change):
    s = settled()
    height = s.particles.state[:, 2].mean()
    s.remove_wall(1 if change == "cylinder" else 0)
    assert s.dormant_count == 0
    s.advance(int(0.1 / s.dt))
    state = s.particles.state
    # Free fall would be 49 mm.
    fell = height - state[:, 2].mean()
    assert np.hypot(state[:, 0], state[:, 1]).max() > 0.07 if change == "cylinder" else fell > 0.02


def test_a_wall_that_vanishes_by_its_time_wakes_the_bed():
    walls = [Wall("plane"), Wall("cylinder", radius=0.06, length=10.0, until_time=0.95)]
    s = bed(300, walls=walls, dormancy=OPTION)
    s.advance(int(0.94 / s.dt))
    assert s.dormant_count > 0.5 * s.count
    s.advance(int(0.06 / s.dt))
    assert np.hypot(*s.particles.state[:, :2].T).max() > 0.06


def test_tilted_gravity_wakes_all_and_the_bed_slides_as_without():
    slid = []
    for option in (OPTION, None):
        s = settled(option)
        middle = s.particles.state[:, 0].mean()
        s.gravity = np.array([7.0, 0.0, -7.0])
        s.advance(1)
        assert s.dormant_count == 0
        s.advance(int(0.1 / s.dt))
        slid.append(s.particles.state[:, 0].mean() - middle)
    assert slid[1] > 0.05 * SMALLEST
    assert slid[0] == pytest.approx(slid[1], rel=0.1)


def test_a_belt_that_starts_carries_the_bed_and_keeps_its_neighbours_awake():
    s = settled()
    s.replace_wall(0, Wall("plane", surface_velocity=(0.3, 0.0, 0.0)))
    s.advance(int(0.3 / s.dt))
    near = s.near_walls
    belt = near.owner[np.add.reduceat(near.wall == 0, near.start[:-1]) > 0]
    assert len(belt) > 10
    assert not s.dormant.state[belt].any()


def test_threads_chunks_and_a_restart_do_not_change_a_bit(tmp_path):
    runs = []
    for threaded, chunks in ((False, [3000]), (True, [3000]), (False, [1, 199, 333, 1000, 1467])):
        s = settled(threaded=threaded)
        drop(s)
        for steps in chunks:
            s.advance(steps)
            numbers, arrays = s.stored()
            checkpoint.save(tmp_path / "run", numbers, arrays)
            s = settled(threaded=threaded)
            s.restore(*checkpoint.load(tmp_path / "run"))
        runs.append(s)
    assert runs[0].dormant_count > 0
    assert len({by_number(s).tobytes() for s in runs}) == 1
    assert len({s.searches for s in runs}) == 1


def test_a_number_that_is_not_finite_is_found_among_the_dormant():
    s = settled()
    row = int(np.flatnonzero(s.dormant.state != AWAKE)[0])
    s.particles.state[row, 0] = np.nan
    with pytest.raises(BlowUp, match="no longer finite"):
        s.check()


def test_without_gravity_nobody_falls_dormant():
    s = bed(50, gravity=(0.0, 0.0, 0.0), walls=[], dormancy=OPTION)
    s.advance(1000)
    assert s.dormant_count == 0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("speed_share", -0.1),
        ("force_share", 0.6),
        ("wake_share", 0.01),
        ("duration_share", 0.0),
        ("speed_share", float("nan")),
    ],
)
def test_what_dormancy_may_not_be(name, value):
    with pytest.raises(InputError, match=f"dormancy.{name}"):
        Dormancy(**{name: value})


def test_a_case_with_dormancy_says_so_and_resumes_with_the_same_bits(tmp_path, monkeypatch):
    monkeypatch.setattr("demcore.run.REPORT_SECONDS", 0.0)
    case = replace(a_case(fills=(a_fill(mass=0.3),), duration=1.0, rest=None), dormancy=OPTION)
    whole = simulate(case)
    assert whole.assumptions["dormancy"] == OPTION.sentence()
    assert "computed" in simulate(replace(case, dormancy=None, duration=0.001)).assumptions["dormancy"]
    assert (whole.velocities == 0.0).all(axis=1).mean() > 0.3
    path = tmp_path / "run"

    def stop(progress):
        return progress.time_s < 0.8

    with pytest.raises(Cancelled):
        simulate(case, stop, checkpoint_path=path)
    resumed = simulate(case, checkpoint_path=path)
    assert resumed.positions.tobytes() == whole.positions.tobytes()
    assert resumed.searches == whole.searches


def test_a_case_without_gravity_has_no_dormancy():
    with pytest.raises(InputError, match="dormancy"):
        a_case(gravity=(0.0, 0.0, 0.0), rest=None, dormancy=OPTION)


def test_the_pile_test_takes_the_option_into_its_case():
    arguments = argparse.ArgumentParser()
    pile.add_parser(arguments.add_subparsers())
    assert pile.pile_test(arguments.parse_args(["pile", "pellet", "--dormancy"])).case.dormancy == OPTION
    assert pile.pile_test(arguments.parse_args(["pile", "pellet"])).case.dormancy is None

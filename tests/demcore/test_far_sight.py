"""How far each particle is searched for neighbours: its speed decides, and no contact is ever missed."""

from __future__ import annotations

import numpy as np
import pytest

from demcore import wall_search
from demcore.forces import touching_contacts
from demcore.geometry.walls import Wall
from demcore.neighbours import LONGEST_LOOK, reaches
from demcore.particles import VX, VZ, R, X, Z, spheres
from tests.demcore.builders import bed, by_number
from tests.demcore.wall_builders import plate_mesh

DT = 1e-4
SKIN = 0.004


def moving(speeds, radius=0.01):
    rng = np.random.default_rng(1)
    velocity = rng.normal(size=(len(speeds), 3))
    velocity *= (np.asarray(speeds) / np.sqrt((velocity**2).sum(axis=1)))[:, None]
    return spheres(
        rng.random((len(speeds), 3)), np.full(len(speeds), radius), 1000.0, velocity=velocity
    ).state


def test_over_a_bed_at_rest_the_fast_ones_look_as_far_as_they_go_in_the_longest_time():
    speeds = [0.0] * 95 + [0.3] * 5
    reach = reaches(moving(speeds), SKIN, DT)
    assert reach[:95] == pytest.approx(0.01 + 0.5 * SKIN, rel=1e-12)
    assert reach[95:] == pytest.approx(0.01 + 0.5 * SKIN + 0.3 * LONGEST_LOOK * DT, rel=1e-12)


def test_where_all_move_nobody_looks_beyond_what_most_go_in_half_a_skin():
    # Nine in ten go at most 2 m/s: half a skin in 1 ms.
    reach = reaches(moving([2.0] * 95 + [5.0] * 5), SKIN, DT)
    assert reach[:95] == pytest.approx(0.01 + SKIN, rel=1e-12)
    assert reach[95:] == pytest.approx(0.01 + 0.5 * SKIN + 5.0 * 1e-3, rel=1e-12)


def test_a_stray_bullet_reaches_no_farther_than_the_largest_radius():
    reach = reaches(moving([0.0] * 20 + [1000.0]), SKIN, DT)
    assert reach[-1] == pytest.approx(0.02 + 0.5 * SKIN, rel=1e-12)


def missed(s):
    """Pairs that overlap by more than a step's way and are in no list of contacts."""
    x, r = s.particles.state[:, X : Z + 1], s.particles.state[:, R]
    speed = np.sqrt((s.particles.state[:, VX : VZ + 1] ** 2).sum(axis=1))
    overlap = r[:, None] + r[None] - np.sqrt(((x[:, None] - x[None]) ** 2).sum(axis=2))
    i, j = np.nonzero(np.triu(overlap > 2.0 * (speed[:, None] + speed[None]) * s.dt, k=1))
    contacts = touching_contacts(s.neighbours)
    known = set(zip(contacts.owner.tolist(), contacts.partner.tolist(), strict=True))
    return [pair for pair in zip(i.tolist(), j.tolist(), strict=True) if pair not in known]


@pytest.mark.parametrize("threaded", [False, True])
def test_grains_shot_into_a_bed_miss_no_contact(threaded):
    s = bed(250, walls=[])
    s.threaded = threaded
    rng = np.random.default_rng(3)
    shot = rng.choice(250, 12, replace=False)
    s.particles.state[shot, VX : VZ + 1] = rng.normal(size=(12, 3)) * 8.0
    met = 0
    for _ in range(120):
        s.advance(5)
        assert missed(s) == []
        met = max(met, len(touching_contacts(s.neighbours).owner))
    assert met > 10
    assert s.searches > 1


def test_a_few_fast_grains_call_for_few_searches_and_change_nothing():
    """As if there were a search every step: the same motion but for the order of sums."""
    runs = []
    for often in (False, True):
        s = bed(250, walls=[], gravity=(0.0, 0.0, 0.0))
        s.particles.state[:, VX : VZ + 1] = 0.0
        s.particles.state[::50, VX] = 3.0
        for _ in range(400):
            s.stale = s.stale or often
            s.advance(1)
        runs.append(s)
    rare, each_step = runs
    assert each_step.searches == 400
    assert rare.searches < 40
    a, b = (by_number(s)[:, X : Z + 1] for s in runs)
    assert np.abs(a - b).max() < 1e-9


@pytest.mark.parametrize("threaded", [False, True])
def test_walls_that_nobody_can_have_met_are_passed_over_without_a_change_of_a_bit(threaded, monkeypatch):
    walls = [
        Wall("mesh", mesh=plate_mesh(0.3, 8)),
        Wall("cylinder", radius=0.06, length=10.0),
        Wall("plane", centre=(0.0, 0.0, -0.002), velocity=(0.0, 0.0, 0.003)),
    ]
    runs, passed_over, moving = [], 0, 0
    for look_at_all in (False, True):
        if look_at_all:
            monkeypatch.setattr(wall_search, "note_clear", lambda *_: None)
        s = bed(120, walls=walls, threaded=threaded)
        for _ in range(60):
            s.advance(50)
            near = s.near_walls
            passed_over += int((near.clear > 0.0).sum())
            moving += int((near.wall == 2).sum())
            assert (near.clear[near.wall == 2] < 0.0).all(), "a wall that moves may come"
        runs.append(by_number(s).tobytes())
        assert passed_over > 1000 and moving > 10
    assert runs[0] == runs[1]

"""Who leaves the domain is logged once, with where, when and by which side."""

from __future__ import annotations

import math

import numpy as np

from demcore.departures import SIDES, DepartureLog
from demcore.particles import spheres
from demcore.region import Box
from tests.demcore.builders import bed


def test_each_side_is_named_and_who_is_outside_two_left_by_the_farther_one():
    position = np.array(
        [[0.5, 0.5, 0.5], [-0.1, 0.5, 0.5], [1.2, 0.5, 0.5], [0.5, -1.0, 0.5], [0.5, 1.5, 0.5], [0.5, 0.5, -2.0],
         [0.5, 0.5, 1.1], [1.3, 1.2, 0.5]]
    )  # fmt: skip
    particles = spheres(position, np.full(8, 0.01), 2500.0, velocity=np.arange(24.0).reshape(8, 3))
    log = DepartureLog()
    stays = log.note(particles, 17, np.zeros(3), np.ones(3))
    assert stays.tolist() == [True] + [False] * 7
    left = log.all()
    assert [SIDES[k] for k in left.side] == ["-x", "+x", "-y", "+y", "-z", "+z", "+x"]
    assert left.number.tolist() == [1, 2, 3, 4, 5, 6, 7]
    assert set(left.step) == {17}
    assert (left.position == position[1:]).all()
    assert (left.velocity == particles.state[1:, 4:7]).all()
    assert (left.mass == particles.state[1:, 7]).all()
    assert len(log) == 7


def test_a_falling_bed_leaves_by_the_floor_in_order_of_time():
    s = bed(60, walls=[])
    mass = s.particles.state[np.argsort(s.particles.number), 7]
    s.domain = Box((-1.0, -1.0, -0.2), (1.0, 1.0, math.inf))
    s.advance(int(0.5 / s.dt))
    left = s.left.all()
    assert s.count == 0
    assert sorted(left.number) == list(range(60))
    assert (np.diff(left.step) >= 0).all()
    assert {SIDES[k] for k in left.side} == {"-z"}
    assert (left.mass == mass[left.number]).all()
    # All fall alike, so nobody looks farther than the skin: noticed close below the floor.
    assert left.position[:, 2].max() <= -0.2
    assert left.position[:, 2].min() > -0.2 - 2.0 * s.skin - 3.5 * s.dt
    # Free fall: v^2 = 2 g h from where each started.
    assert (left.velocity[:, 2] < -1.9).all()


def test_numbers_are_for_life():
    s = bed(20, walls=[])
    s.floor = -0.05
    s.advance(int(0.12 / s.dt))
    gone = set(s.left.all().number)
    assert 0 < len(gone) < 20
    s.add(spheres(np.array([[0.0, 0.0, 5.0], [0.0, 0.1, 5.0]]), np.array([0.01, 0.01]), 2500.0))
    s.advance(1)
    assert {20, 21} <= set(s.particles.number)
    assert gone.isdisjoint(s.particles.number)
    assert s.next_number == 22

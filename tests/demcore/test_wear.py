"""Strikes and loads of walls against what a ball and a bed must bring."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from demcore.experiments.wear_drawing import plan_map, wall_map
from demcore.geometry.wall_arrays import wall_arrays
from demcore.geometry.walls import Wall
from demcore.insertion import walls_at
from demcore.observables.wear import CELL, Strike, WearMap, find_loads, find_strikes
from demcore.particles import spheres
from demcore.plant.plant_file import load_plant
from tests.demcore.builders import bed
from tests.demcore.wall_builders import plate_mesh

MASS = 2500.0 * 4.0 / 3.0 * math.pi * 0.01**3


def fly(walls, position, velocity, dt=0.01):
    """One ball of 10 mm radius flies in a straight line, looked at every dt; all its strikes up to a second."""
    rows, place = wall_arrays(walls), np.array(position, float)
    present = walls_at(rows, 0, 1.0)
    found = []
    for k in range(100):
        state = spheres(np.array([place + k * dt * np.array(velocity)]), np.array([0.01]), 2500.0).state
        state[:, 4:7] = velocity
        found.append(find_strikes(state, rows, present, dt))
    return found


@pytest.mark.parametrize(
    "wall",
    [Wall("disc", radius=5.0), Wall("mesh", mesh=plate_mesh(4.0, 3)), Wall("plane")],
    ids=["disc", "mesh", "plane"],
)
def test_a_ball_strikes_once_with_the_energy_of_its_speed_across_the_wall(wall):
    strikes = [s for s in fly([wall], (0.0, 0.0, 1.0), (1.0, 0.0, -3.0)) if len(s.wall)]
    # A plane is solid: behind it the ball is inside, and strikes no more; the others it comes out of.
    assert len(strikes) == 1
    assert strikes[0].energy == pytest.approx([0.5 * MASS * 9.0])
    assert strikes[0].place[0, 2] == pytest.approx(0.0, abs=1e-12)
    assert strikes[0].place[0, 0] == pytest.approx(0.33, abs=0.01)


def test_a_ball_that_flies_by_strikes_nothing():
    assert not any(len(s.wall) for s in fly([Wall("disc", radius=5.0)], (0.0, 0.0, 0.02), (3.0, 0.0, 0.0)))
    assert not any(len(s.wall) for s in fly([Wall("disc", radius=0.2)], (0.3, 0.0, 0.5), (0.0, 0.0, -3.0)))


def test_the_load_on_the_floor_is_the_beds_weight():
    s = bed(100)
    s.advance(int(1.0 / s.dt))
    wear = WearMap()
    for _ in range(20):
        s.advance(50)
        wear.load(find_loads(s.particles.state, s.near_walls))
    load = wear.by_wall(2)[0, 2]
    # The tube's wall carries the rest by friction, and sideways.
    assert 0.6 * s.mass * 9.81 < load < 1.01 * s.mass * 9.81


def test_a_map_adds_up_by_cell_and_comes_back_from_a_checkpoint():
    wear = WearMap()
    place = np.array([[0.01, 0.0, 0.0], [0.02, 0.01, 0.01], [CELL + 0.01, 0.0, -0.01]])
    wear.strike(Strike(np.array([2, 2, 0]), place, np.array([1.0, 2.0, 5.0])))
    wear.load(Strike(np.array([2]), place[:1], np.array([8.0])))
    wear.load(Strike(np.array([2]), place[:1], np.array([4.0])))
    again = WearMap()
    again.restore(json.loads(json.dumps(wear.numbers())))
    for made in (wear, again):
        wall, middle, values = made.rows()
        assert wall.tolist() == [0, 2]
        assert middle == pytest.approx(np.array([[1.5, 0.5, -0.5], [0.5, 0.5, 0.5]]) * CELL)
        assert values.tolist() == [[5.0, 1.0, 0.0], [3.0, 2.0, 6.0]]
        assert made.by_wall(3).tolist() == [[5.0, 1.0, 0.0], [0.0, 0.0, 0.0], [3.0, 2.0, 6.0]]


def test_flat_maps_hold_what_their_walls_bear():
    """Azimuths of 2 and 182 degrees: the first and the 37th of 72 sectors; the bell's cells add up over height."""
    names = np.array(["hopper", "hopper cone", "bell", "bell", "belt"])
    place = np.array(
        [[1.8, 0.06, -0.55], [-1.5, -0.05, -2.75], [0.55, 0.25, -2.0], [0.55, 0.25, -1.9], [0.55, 0.25, 2.0]]
    )
    value = np.array([1.0, 2.0, 3.0, 4.0, 50.0])
    unrolled = wall_map(load_plant(), names, place, value)
    assert np.argwhere(unrolled).tolist() == [[0, 22], [36, 0]]
    assert unrolled[0, 22] == 1.0 and unrolled[36, 0] == 2.0
    assert plan_map(names, place, value, ("bell", "rod")) == {(5, 2): 7.0}
    assert plan_map(names, place, value, ("deflector",)) == {}

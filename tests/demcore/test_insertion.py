"""Fills: inside their region, no overlaps with each other, with what is there, or with walls."""

from __future__ import annotations

import math

import numpy as np
import pytest

from demcore.errors import InputError
from demcore.geometry.mesh import TriangleMesh
from demcore.geometry.wall_arrays import wall_arrays
from demcore.geometry.walls import Wall
from demcore.insertion import choose_places, fill_cylinder, fill_region
from demcore.region import Box, Cone, cylinder

NO_WALLS = wall_arrays([])
NONE = np.zeros(0, bool)
REGIONS = {
    "box": Box((-0.2, 0.1, 0.3), (0.2, 0.4, 1.0)),
    "cylinder": cylinder((0.5, -0.2, -0.3), 0.15, 1.0),
    "hopper": Cone((0.0, 0.0, 0.2), 0.5, 0.05, 0.3),
    "heap": Cone((0.0, 0.0, 0.0), 0.5, 0.3, 0.0),
}


def smallest_gap(x, r, y, s):
    """Between two sets of spheres, m, negative where they overlap."""
    gap = np.sqrt(((x[:, None] - y[None]) ** 2).sum(axis=2)) - r[:, None] - s[None]
    return gap[np.triu_indices(len(x), 1)].min() if x is y else gap.min()


def room_left(region, x, r):
    """Least distance of the spheres to the region's side, m."""
    if isinstance(region, Box):
        inside = np.minimum(x - np.array(region.lower), np.array(region.upper) - x).min(axis=1)
        return (inside - r).min()
    slope = (region.upper_radius - region.lower_radius) / region.height
    up = x[:, 2] - region.base[2]
    rho = np.hypot(x[:, 0] - region.base[0], x[:, 1] - region.base[1])
    side = (region.lower_radius + slope * up - rho) / math.hypot(1.0, slope)
    return (np.minimum(side, np.minimum(up, region.height - up)) - r).min()


@pytest.mark.parametrize("name", REGIONS)
def test_a_fill_has_no_overlaps_and_stays_inside_its_region(name):
    rng = np.random.default_rng(4)
    radius = rng.uniform(0.002, 0.02, 400)  # size ratio 10
    x = fill_region(REGIONS[name], radius, rng, NO_WALLS)
    assert smallest_gap(x, radius, x, radius) >= 0.0
    assert room_left(REGIONS[name], x, radius) >= -1e-12


def test_a_fill_lies_as_low_as_it_finds_room():
    rng = np.random.default_rng(4)
    radius = np.full(200, 0.01)
    x = fill_region(cylinder((0.0, 0.0, 0.0), 0.1, 50.0), radius, rng, NO_WALLS)
    # 200 spheres of 4.2 ml, a quarter to a third solid, in 314 cm2
    assert 0.08 < x[:, 2].max() < 0.14


def test_a_second_fill_keeps_clear_of_the_first_and_of_walls():
    rng = np.random.default_rng(2)
    box = Box((0.0, 0.0, 0.0), (0.3, 0.3, 0.3))
    first = rng.uniform(0.01, 0.02, 150)
    x = fill_region(box, first, rng, NO_WALLS)
    second = rng.uniform(0.004, 0.008, 600)
    walls = wall_arrays(
        [Wall("plane", centre=(0.0, 0.0, 0.05)), Wall("disc", (0.15, 0.15, 0.15), radius=0.1)]
    )
    y = fill_region(box, second, rng, walls, x, first)
    assert smallest_gap(x, first, y, second) >= 0.0
    assert smallest_gap(y, second, y, second) >= 0.0
    assert (y[:, 2] - second).min() >= 0.05  # above the plane, which is solid below
    over = np.hypot(y[:, 0] - 0.15, y[:, 1] - 0.15) < 0.1
    assert over.sum() > 20
    assert (np.abs(y[over, 2] - 0.15) - second[over]).min() >= 0.0


def test_a_fill_keeps_clear_of_a_mesh():
    # A square plate of two triangles across a box.
    plate = TriangleMesh(
        np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    walls = wall_arrays([Wall("mesh", (0.0, 0.0, 0.045), mesh=plate)])
    rng = np.random.default_rng(3)
    radius = rng.uniform(0.01, 0.02, 150)
    x = fill_region(Box((-0.2, -0.2, 0.0), (0.2, 0.2, 0.6)), radius, rng, walls)
    assert (np.abs(x[:, 2] - 0.045) - radius).min() >= 0.0
    assert (x[:, 2] < 0.045).sum() > 10
    assert (x[:, 2] > 0.045).sum() > 10


def test_a_wall_that_comes_later_takes_no_room():
    rng = np.random.default_rng(2)
    walls = wall_arrays([Wall("disc", (0.0, 0.0, 0.02), radius=1.0, from_time=1.0)])
    x = fill_region(cylinder((0.0, 0.0, 0.0), 0.1, 0.1), np.full(60, 0.01), rng, walls)
    assert (np.abs(x[:, 2] - 0.02) < 0.01).any()


def test_a_region_that_cannot_hold_the_fill_says_what_it_holds():
    rng = np.random.default_rng(1)
    with pytest.raises(InputError, match=r"of the volume") as caught:
        fill_region(Box((0.0, 0.0, 0.0), (0.1, 0.1, 0.1)), np.full(1000, 0.01), rng, NO_WALLS)
    assert caught.value.field == "fill.region"


def test_a_particle_larger_than_the_cylinder_is_refused():
    with pytest.raises(InputError):
        fill_cylinder(np.array([0.11]), 0.1, np.random.default_rng(1))


def test_places_are_chosen_in_order_and_each_sees_those_before_it():
    points = np.zeros((3, 2, 3))
    points[:, 1, 0] = 1.0  # all try the origin first, then one metre along x
    radius = np.full(3, 0.1)
    position, size = np.zeros((3, 3)), np.zeros(3)
    assert choose_places(points, radius, position, size, 0, NO_WALLS, NONE, 9).tolist() == [0, 1, -1]
    solid = wall_arrays([Wall("plane", centre=(0.0, 0.0, 1.0))])
    assert choose_places(
        points, radius, np.zeros((3, 3)), np.zeros(3), 0, solid, np.ones(1, bool), 2
    ).tolist() == [-1, -1, -1]

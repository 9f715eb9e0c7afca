"""The slope of a heap, read from surfaces whose slope is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from demcore.observables.burden import Surface
from demcore.observables.pile_slope import pile_slope


def a_surface(height, radius=1.9, grid=0.02):
    """Height over a level floor 5 m below, inside a circle."""
    axis = np.arange(-radius, radius + grid / 2.0, grid)
    x, y = (a.ravel() for a in np.meshgrid(axis, axis))
    inside = np.hypot(x, y) < radius
    x, y = x[inside], y[inside]
    return Surface(x, y, height(x, y), np.full(len(x), -5.0), grid * grid)


def cone(angle_deg, azimuth_deg, radius):
    turn = math.radians(azimuth_deg)
    x0, y0 = radius * math.cos(turn), radius * math.sin(turn)
    return lambda x, y: -math.tan(math.radians(angle_deg)) * np.hypot(x - x0, y - y0)


@pytest.mark.parametrize("angle", [25.0, 36.5])
def test_a_cone_by_the_wall_has_its_angle(angle):
    """On the side of the wall the flank is too short, the other directions are read. A plane through a wedge of
    22.5 degrees reads a cone high, by less than 1 / cos(11.25 degrees): up to .5 degrees."""
    slope = pile_slope(a_surface(cone(angle, 300.0, 1.4)), 300.0, 1.4)
    assert angle < slope.angle_deg < angle + 0.2
    assert 4 <= slope.directions < 16
    assert slope.error_deg < 0.05


@pytest.mark.parametrize("turn", [0.0, 40.0])
def test_a_ridge_is_as_steep_as_its_flanks_and_not_as_its_crest(turn):
    """A roof of 33 degrees whose crest falls by 6: each flank descends by atan(hypot) of the two."""
    along, across = math.tan(math.radians(6.0)), math.tan(math.radians(33.0))
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))

    def roof(x, y):
        u, v = (x - 0.3) * c + y * s, -(x - 0.3) * s + y * c
        return -across * np.abs(v) - along * np.abs(u)

    slope = pile_slope(a_surface(roof), 0.0, 0.3)
    assert slope.angle_deg == pytest.approx(math.degrees(math.atan(math.hypot(along, across))), abs=0.1)
    assert slope.directions >= 12


def test_what_does_not_fall_or_is_floor_says_nothing():
    level = a_surface(lambda x, y: 0.0 * x)
    assert pile_slope(level, 0.0, 1.0).directions == 0
    assert math.isnan(pile_slope(level, 0.0, 1.0).angle_deg)
    bare = a_surface(lambda x, y: np.full(len(x), -5.0))
    assert pile_slope(bare, 0.0, 1.0).directions == 0


def test_of_two_heaps_each_is_read_on_its_free_side():
    two = [cone(35.0, 200.0, 1.3), cone(28.0, 340.0, 1.3)]
    surface = a_surface(lambda x, y: np.maximum(two[0](x, y), two[1](x, y)))
    assert pile_slope(surface, 200.0, 1.3).angle_deg == pytest.approx(35.0, abs=3.0)
    assert pile_slope(surface, 340.0, 1.3).angle_deg == pytest.approx(28.0, abs=3.0)

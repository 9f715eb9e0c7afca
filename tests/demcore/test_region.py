"""Regions and inlets: volumes, what fits, and where their points lie."""

from __future__ import annotations

import math

import numpy as np
import pytest

from demcore.errors import InputError
from demcore.region import Box, Cone, DiscInlet, RectangleInlet, cylinder


def test_volumes_are_the_textbooks():
    assert Box((0.0, 0.0, -1.0), (1.0, 2.0, 3.0)).volume == 8.0
    assert Box((0.0, 0.0, -1.0), (1.0, 2.0, 3.0)).volume_below(0.0) == pytest.approx(2.0)
    assert cylinder((0.0, 0.0, 0.0), 0.5, 2.0).volume == pytest.approx(math.pi * 0.5)
    # cone on its tip: pi r^2 h / 3, and an eighth of it below half of its height
    tip = Cone((0.0, 0.0, 1.0), 3.0, 0.0, 1.0)
    assert tip.volume == pytest.approx(math.pi)
    assert tip.volume_below(2.5) == pytest.approx(math.pi / 8.0)
    assert tip.volume_below(0.0) == 0.0
    assert tip.volume_below(99.0) == pytest.approx(math.pi)


def test_the_largest_sphere_of_a_cone_is_its_insphere():
    # A cone of height h and radius R: r = R h / (R + sqrt(R^2 + h^2)).
    expected = 1.0 * 3.0 / (1.0 + math.sqrt(10.0))
    assert Cone((0.0, 0.0, 0.0), 3.0, 0.0, 1.0).largest_radius == pytest.approx(expected)
    assert Cone((0.0, 0.0, 0.0), 3.0, 1.0, 0.0).largest_radius == pytest.approx(expected)
    assert cylinder((0.0, 0.0, 0.0), 0.5, 10.0).largest_radius == pytest.approx(0.5)
    assert cylinder((0.0, 0.0, 0.0), 0.5, 0.4).largest_radius == pytest.approx(0.2)
    assert Box((0.0, 0.0, 0.0), (1.0, 2.0, 3.0)).largest_radius == 0.5


def test_points_of_a_disc_keep_the_whole_sphere_inside_its_outline_and_are_uniform():
    inlet = DiscInlet((1.0, 2.0, 3.0), 0.5, normal=(1.0, 1.0, 0.0))
    points = inlet.points(np.random.default_rng(1).random((4000, 2)), 0.1) - np.array([1.0, 2.0, 3.0])
    assert np.abs(points @ np.array([1.0, 1.0, 0.0])).max() < 1e-12
    rho = np.sqrt((points**2).sum(axis=1))
    assert rho.max() <= 0.4
    # Uniform in area: half of them within 0.4 / sqrt(2).
    assert (rho < 0.4 / math.sqrt(2.0)).mean() == pytest.approx(0.5, abs=0.03)


def test_points_of_a_rectangle_keep_the_whole_sphere_inside_its_outline():
    inlet = RectangleInlet((0.0, 0.0, 1.0), (0.3, 0.0, 0.0), (0.0, 0.0, 0.2))
    points = inlet.points(np.random.default_rng(1).random((4000, 2)), 0.1)
    assert np.abs(points[:, 0]).max() == pytest.approx(0.2, abs=1e-3)
    assert np.abs(points[:, 2] - 1.0).max() == pytest.approx(0.1, abs=1e-3)
    assert (points[:, 1] == 0.0).all()
    assert inlet.largest_radius == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("build", "field"),
    [
        (lambda: Box((0.0, 0.0, 0.0), (1.0, 0.0, 1.0)), "box.upper"),
        (lambda: Box((0.0, math.nan, 0.0), (1.0, 1.0, 1.0)), "box.lower"),
        (lambda: Cone((0.0, 0.0, 0.0), -1.0, 1.0, 1.0), "cone.height"),
        (lambda: Cone((0.0, 0.0, 0.0), 1.0, 0.0, 0.0), "cone.upper_radius"),
        (lambda: Cone((0.0, 0.0, math.inf), 1.0, 1.0, 1.0), "cone.base"),
        (lambda: DiscInlet((0.0, 0.0, 0.0), 0.0), "inlet.radius"),
        (lambda: DiscInlet((0.0, 0.0, 0.0), 1.0, (0.0, 0.0, 0.0)), "inlet.normal"),
        (lambda: RectangleInlet((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0)), "inlet.second"),
        (lambda: RectangleInlet((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 1.0, 0.0)), "inlet.first"),
    ],
)
def test_bad_shapes_are_refused(build, field):
    with pytest.raises(InputError) as caught:
        build()
    assert caught.value.field == field

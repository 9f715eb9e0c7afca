"""The angle readings: exact on cones, and the published angles of an independent code's piles."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from demcore.errors import NoResult
from demcore.observables.repose_angle import (
    HeightField,
    heap_profile,
    literal_reading,
    scan_heights,
    surface_scan,
)

DATA = Path(__file__).parents[1] / "data"


def cone(angle_deg: float, base_radius: float, height_at_axis: float) -> HeightField:
    half = round(base_radius / 0.004)
    axis = np.arange(-half, half + 1) * 0.004
    x, y = np.meshgrid(axis, axis, indexing="ij")
    height = np.maximum(height_at_axis - math.tan(math.radians(angle_deg)) * np.hypot(x, y), 0.0)
    return HeightField(height, axis)


@pytest.mark.parametrize("angle", [12.0, 25.5, 36.5, 41.0])
def test_a_cone_has_its_own_angle(angle):
    reading = surface_scan(cone(angle, 0.3, 0.3), 0.3)
    assert reading.mean == pytest.approx(angle, abs=1e-6)
    assert reading.standard_error == pytest.approx(0.0, abs=1e-6)
    assert reading.intercept == pytest.approx(0.3, abs=1e-9)


def test_one_sphere_is_seen_as_its_upper_half():
    field = scan_heights(np.array([[0.05, -0.02, 0.03]]), np.array([0.02]), 0.1)
    x, y = np.meshgrid(field.axis, field.axis, indexing="ij")
    square = 0.02**2 - (x - 0.05) ** 2 - (y + 0.02) ** 2
    expected = np.where(square > 0, 0.03 + np.sqrt(np.maximum(square, 0.0)), 0.0)
    assert np.abs(field.height - expected).max() < 1e-12


@pytest.mark.parametrize(("seed", "scan", "literal"), [(1, 35.6, 24.3), (2, 35.4, 23.2)])
def test_the_piles_of_liggghts_read_as_published(seed, scan, literal):
    # physics.md section 5, table, first row: two LIGGGHTS seeds of the paper's coke coefficients
    pile = np.load(DATA / f"liggghts_pile_seed{seed}.npz")
    position, radius = pile["position"].astype(float), pile["radius"].astype(float)
    assert surface_scan(scan_heights(position, radius, 0.375), 0.375).mean == pytest.approx(scan, abs=0.1)
    reading, few = literal_reading(position, 0.375, 24, 30)
    assert reading.mean == pytest.approx(literal, abs=0.15)
    assert 0.2 < few < 0.5


def test_an_empty_base_has_no_angle():
    field = scan_heights(np.array([[0.0, 0.0, 0.02]]), np.array([0.02]), 0.3)
    with pytest.raises(NoResult, match="bare"):
        surface_scan(field, 0.3)


def test_the_profile_of_a_cone_is_its_line():
    profile = heap_profile(cone(30.0, 0.3, 0.2), 0.3, rings=15)
    expected = np.maximum(0.2 - math.tan(math.radians(30.0)) * profile.radius, 0.0)
    assert np.abs(profile.height - expected).max() < 0.004
    assert (profile.low <= profile.height + 1e-12).all()
    assert (profile.height <= profile.high + 1e-12).all()


def heap_of_spheres(diameter: float, seed: int) -> np.ndarray:
    """Centres of spheres, .6 solid, that fill a cone of 30 degrees on a base of 0.3 m radius up to its surface."""
    rng = np.random.default_rng(seed)
    base, slope = 0.3, math.tan(math.radians(30.0))
    volume = math.pi * base**2 * base * slope / 3.0
    count = int(0.6 * volume / (math.pi / 6.0 * diameter**3))
    down = rng.random(count) ** (
        1.0 / 3.0
    )  # share of the way from the apex to the base, uniform in the volume
    rho, angle = base * down * np.sqrt(rng.random(count)), 2.0 * math.pi * rng.random(count)
    below = 0.5 * diameter * math.hypot(1.0, slope)
    z = np.maximum(base * slope * (1.0 - down) - below, 0.5 * diameter)
    return np.column_stack([rho * np.cos(angle), rho * np.sin(angle), z])


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_literal_reading_comes_nearer_to_the_scan_as_grains_get_finer(seed):
    # physics.md section 5: it sits 9 to 11 degrees low on a coarse pile and converges to the scan
    gaps, few = [], []
    for diameter in (0.020, 0.010, 0.006):
        position = heap_of_spheres(diameter, seed)
        field = scan_heights(position, np.full(len(position), diameter / 2.0), 0.3)
        scan = surface_scan(field, 0.3).mean
        reading, share = literal_reading(position, 0.3, 24, 30)
        gaps.append(scan - reading.mean)
        few.append(share)
    assert scan == pytest.approx(30.0, abs=0.3)
    assert gaps[0] > 5.0
    assert gaps[1] < 0.6 * gaps[0]
    assert 0.0 < gaps[2] < 1.2
    assert few[0] > 0.3
    assert few[2] < 0.01


def test_the_literal_reading_comes_nearer_to_the_scan_on_real_piles_of_three_scales():
    # The pellet's pile test at coarse-graining 4, 2 and 1: 6, 3 and 1 seeds (tests/data/README.md)
    gap, few = {4: [], 2: [], 1: []}, {4: [], 2: [], 1: []}
    with np.load(DATA / "pellet_piles.npz") as piles:
        for name, pile in piles.items():
            scale, position, radius = int(name[5]), *np.split(pile.astype(np.float64), [3], axis=1)
            scan = surface_scan(scan_heights(position, radius[:, 0], 0.3), 0.3)
            reading, share = literal_reading(position, 0.3, 24, 20)
            gap[scale].append(scan.mean - reading.mean)
            few[scale].append(share)
    mean = {scale: np.mean(found) for scale, found in gap.items()}
    assert {scale: len(found) for scale, found in gap.items()} == {4: 6, 2: 3, 1: 1}
    assert mean[4] > mean[2] > mean[1] > 0.0
    assert mean[1] < 0.6 * mean[2]
    assert min(few[4]) > max(few[2]) > 10.0 * max(few[1])

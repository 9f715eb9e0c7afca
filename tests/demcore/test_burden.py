"""The burden's measures on synthetic burdens whose answers are known in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from demcore.observables.burden import (
    Bowl,
    Shadow,
    Surface,
    bell_layer,
    cause_of,
    far_share,
    find_depressions,
    find_peaks,
    find_piles,
    harmonic,
    mean_size,
    measure_sectors,
    scan_surface,
    sector_middles,
    sector_of,
    segregation,
    side_sizes,
    variation,
)

FLAT = Bowl(np.array([0.1, 1.0]), np.array([-1.0, -1.0]))
THETA = np.radians(sector_middles(24))


def ring(count, radius=0.6, z=-0.9):
    """Centres evenly around a circle, none on a sector's border."""
    angle = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(count, z)])


def field(top):
    """A flat bowl's surface at heights top(theta, r), in closed form."""
    axis = np.arange(-50, 51) * 0.02
    x, y = (a.ravel() for a in np.meshgrid(axis, axis, indexing="ij"))
    r = np.hypot(x, y)
    inside = (r >= 0.1) & (r <= 1.0)
    x, y, r = x[inside], y[inside], r[inside]
    return Surface(x, y, top(np.arctan2(y, x), r), np.full(len(x), -1.0), 4e-4)


def test_sectors_go_counter_clockwise_from_x():
    x = np.array([1.0, 0.0, -1.0, 0.0, 1.0])
    y = np.array([1e-9, 1.0, 1e-9, -1.0, -1e-9])
    assert sector_of(x, y, 4).tolist() == [0, 1, 1, 3, 3]
    assert sector_middles(4).tolist() == [45.0, 135.0, 225.0, 315.0]


def test_an_even_ring_has_no_variation_and_no_harmonics():
    position, radius, mass = ring(240), np.full(240, 0.01), np.full(240, 2.0)
    s = measure_sectors(position, radius, mass, field(lambda t, r: np.full(len(r), -0.5)))
    assert s.mass.tolist() == [20.0] * 24
    assert s.particles.tolist() == [10] * 24
    assert s.height == pytest.approx(np.full(24, -0.5))
    assert s.size == pytest.approx(np.full(24, 0.02))
    assert variation(s.mass) == 0.0
    assert harmonic(s.mass, 1).amplitude == pytest.approx(0.0, abs=1e-12)
    # Half a metre over a ring of .1 to 1 m.
    assert s.volume.sum() == pytest.approx(0.5 * math.pi * (1.0 - 0.01), rel=0.01)


def test_harmonics_and_variation_of_known_waves():
    """5 (1 + .3 cos(theta - 50) + .1 cos 2 (theta - 20)); the variance of a wave is half its amplitude squared."""
    values = 5.0 * (
        1.0 + 0.3 * np.cos(THETA - math.radians(50.0)) + 0.1 * np.cos(2.0 * (THETA - math.radians(20.0)))
    )
    assert harmonic(values, 1) == pytest.approx((0.3, 50.0))
    assert harmonic(values, 2) == pytest.approx((0.1, 20.0))
    assert harmonic(values, 3).amplitude == pytest.approx(0.0, abs=1e-12)
    assert variation(values) == pytest.approx(math.sqrt(0.5 * (0.09 + 0.01)))
    # A sector without burden has no size; of 1 and 3 the mean is 2 and the deviation 1.
    assert variation(np.array([1.0, math.nan, 3.0])) == pytest.approx(0.5)
    assert math.isnan(variation(np.array([math.nan])))


def test_mean_size_is_by_mass():
    of = np.array([0, 0, 2])
    size = mean_size(of, np.array([0.5, 1.0, 2.0]), np.array([3.0, 1.0, 5.0]), 3)
    assert size[[0, 2]] == pytest.approx([(3.0 * 1.0 + 1.0 * 2.0) / 4.0, 4.0])
    assert math.isnan(size[1])


def test_segregation_is_one_when_apart_and_as_by_chance_when_mixed():
    radius = np.repeat([0.01, 0.02], 500)
    apart = np.repeat([0, 1], 500)
    assert segregation(apart, radius, np.ones(1000), 2)[0] == pytest.approx(1.0)
    even = np.tile([0, 1], 500)
    assert segregation(even, radius, np.ones(1000), 2)[0] == pytest.approx(0.0, abs=1e-12)
    rng = np.random.default_rng(3)
    got = [
        segregation(rng.permutation(np.repeat(np.arange(20), 50)), radius, np.ones(1000), 20)
        for _ in range(200)
    ]
    # Without replacement the chance is (groups - 1) / (grains - 1); the estimate leaves that correction out.
    assert np.mean([index for index, _ in got]) == pytest.approx(19.0 / 999.0, rel=0.05)
    assert got[0][1] == pytest.approx(20.0 / 1000.0)
    assert math.isnan(segregation(even, np.full(1000, 0.01), np.ones(1000), 2)[0])


def test_the_surface_of_one_sphere_on_a_cone():
    """A bowl that rises from -1 m at .1 m to 0 at 1 m; the sphere's cap above the floor by dense sampling."""
    cone = Bowl(np.array([0.1, 1.0]), np.array([-1.0, 0.0]))
    surface = scan_surface(np.array([[0.5, 0.0, -0.4]]), np.array([0.2]), cone, grid=0.005)
    r = np.hypot(surface.x, surface.y)
    assert surface.floor == pytest.approx(-1.0 + (r - 0.1) / 0.9)
    away = np.hypot(surface.x - 0.5, surface.y)
    assert surface.thickness[away > 0.205] == pytest.approx(0.0)
    assert surface.top[away < 0.19].max() == pytest.approx(-0.2, abs=1e-4)
    middle = np.argmin(away)
    assert surface.thickness[middle] == pytest.approx(-0.2 - (-1.0 + 0.4 / 0.9), abs=1e-3)


def test_peaks_of_a_closed_profile_by_prominence():
    profile = np.array([0.0, 3.0, 1.0, 2.0, 1.5, 5.0, 0.5, 0.2])
    peaks = find_peaks(profile, 0.4)
    assert [(p.place, p.prominence) for p in peaks] == [(1, 2.0), (3, 0.5), (5, 5.0)]
    assert [(p.before, p.after) for p in peaks] == [(0, 2), (2, 4), (4, 0)]
    assert [p.place for p in find_peaks(profile, 1.0)] == [1, 5]
    assert [(p.before, p.after) for p in find_peaks(profile, 1.0)] == [(0, 2), (2, 0)]
    assert [p.place for p in find_peaks(profile, 4.0)] == [5]
    assert find_peaks(np.ones(8), 0.0) == []


def test_peaks_do_not_depend_on_where_the_circle_starts():
    profile = np.random.default_rng(1).random(24)
    base = find_peaks(profile, 0.2)
    for shift in (1, 7, 23):
        turned = find_peaks(np.roll(profile, shift), 0.2)
        assert sorted((p.place - shift) % 24 for p in turned) == [p.place for p in base]
        assert sorted(p.prominence for p in turned) == pytest.approx(sorted(p.prominence for p in base))


def two_heaps(theta, r):
    """Heights of heaps at 67.5 and 247.5 degrees, .4 and .2 above the valleys at -.8 m."""
    first = np.clip(np.cos(theta - math.radians(67.5)), 0.0, None) ** 2
    second = np.clip(-np.cos(theta - math.radians(67.5)), 0.0, None) ** 2
    return -0.8 + 0.4 * first + 0.2 * second - 0.05 * np.abs(r - 0.6)


def test_two_heaps_are_found_with_place_height_volume_and_size():
    position = np.concatenate([ring(120), ring(120, 0.5)])
    theta = np.arctan2(position[:, 1], position[:, 0])
    large = np.cos(theta - math.radians(67.5)) > 0.0
    radius = np.where(large, 0.02, 0.01)
    piles = find_piles(position, radius, np.ones(240), field(two_heaps), least=0.05)
    assert [p.azimuth_deg for p in piles] == pytest.approx([67.5, 247.5])
    assert [p.radius for p in piles] == pytest.approx([0.6, 0.6], abs=0.06)
    assert [p.height for p in piles] == pytest.approx([-0.4, -0.6], abs=0.02)
    assert [p.size for p in piles] == pytest.approx([0.04, 0.02], rel=0.1)
    assert sum(p.mass for p in piles) == pytest.approx(240.0)
    # Over half a turn cos^2 has the mean .5: .2 + .2 m and .2 + .1 m thick, less .05 |r - .6|, whose mean over
    # the ring is .0118 m.
    half = 0.5 * math.pi * (1.0 - 0.01)
    assert [p.volume for p in piles] == pytest.approx([half * 0.3882, half * 0.2882], rel=0.03)


def test_depressions_have_depth_and_cause():
    wave = np.cos(THETA - math.radians(67.5))
    heights = -0.8 + 0.4 * np.maximum(wave, 0.0) + 0.2 * np.maximum(-wave, 0.0)
    shadows = (Shadow("under the deflector", 150.0, 20.0), Shadow("behind the rod", -30.0, 20.0))
    valleys = find_depressions(heights, 0.05, shadows)
    assert {v.cause for v in valleys} == {"under the deflector", "behind the rod"}
    assert [v.depth for v in valleys] == pytest.approx([0.3, 0.3])
    assert [v.azimuth_deg for v in valleys] == [157.5, 337.5]
    assert find_depressions(np.ones(24), 0.05, shadows) == []


def test_causes_go_around_the_circle():
    shadow = Shadow("rod", 350.0, 20.0)
    assert [cause_of(a, (shadow,), "none") for a in (331.0, 9.0, 11.0, 329.0)] == [
        "rod",
        "rod",
        "none",
        "none",
    ]


def test_far_is_where_the_belt_runs_to():
    position, mass = ring(360), np.ones(360)
    for meridian in (-90.0, -110.0, 70.0):
        assert far_share(position, mass, meridian) == pytest.approx(0.5, abs=0.01)
    right = position[:, 0] > 0.0
    assert far_share(position[right], mass[right], -90.0) == 1.0
    assert far_share(position[~right], mass[~right], -90.0) == 0.0


def test_the_layer_at_the_bells_rim():
    position = np.array([[1.0, 0.01, -1.0], [0.9, 0.01, -1.0], [-1.0, -0.01, -0.85], [0.0, 1.0, -0.5]])
    mass, size = bell_layer(position, np.array([0.01, 0.02, 0.03, 0.04]), np.ones(4), (1.0, -1.0), 0.2, 4)
    assert mass.tolist() == [2.0, 0.0, 1.0, 0.0]
    assert size[[0, 2]] == pytest.approx([0.03, 0.06])


def test_sizes_of_the_two_sides_by_mass():
    """By hand: far grains of 10 and 30 mm weigh 1 and 3, so 25 mm; near ones 20 mm; an empty side has none."""
    position = np.array([[1.0, 0.0, 0.0], [2.0, 1.0, 0.0], [-1.0, 0.5, 0.0]])
    radius, mass = np.array([0.005, 0.015, 0.010]), np.array([1.0, 3.0, 7.0])
    assert side_sizes(position, radius, mass, -90.0) == pytest.approx((0.020, 0.025))
    near, far = side_sizes(position[:2], radius[:2], mass[:2], -90.0)
    assert math.isnan(near) and far == pytest.approx(0.025)

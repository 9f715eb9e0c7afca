"""Summaries of exact shapes: a sum of harmonics gives its coefficients, a cone its slope and toe."""

from __future__ import annotations

import math

import numpy as np
import pytest

from service.domain.data_set.columns import OBSERVABLES_OF, SECTOR_HEIGHTS, SECTOR_MASSES, SURFACES
from worker.diagnosis.simulator import Outcomes, Surfaces
from worker.diagnosis.summaries import LEAST_SECTORS, NAMES, of_observables, of_surface, summarise

ANGLE = 2.0 * math.pi * np.arange(24) / 24.0


def summary(test: str, values: dict[str, float]) -> dict[str, float]:
    table = summarise(test, Outcomes({name: np.array([v]) for name, v in values.items()}))
    return dict(zip(NAMES[test], table[0].tolist(), strict=True))


def sectors(names: tuple[str, ...], wave: np.ndarray) -> dict[str, float]:  # type: ignore[type-arg]
    return dict(zip(names, wave.tolist(), strict=True))


def test_positive_observables_enter_as_logarithms() -> None:
    found = summary("pile", {"repose_angle_deg": 36.0, "apex_height_m": 0.5, "heap_offset_x_m": -0.01})
    assert found["angle"] == 36.0 and found["ln_apex"] == math.log(0.5) and found["offset_x"] == -0.01
    assert math.isnan(found["ln_mass"]) and math.isnan(found["slope"])


@pytest.mark.parametrize("missing", [0, 5, 24 - LEAST_SECTORS])
def test_harmonics_of_the_heights_are_exact_with_sectors_missing(missing: int) -> None:
    wave = (
        0.8 + 0.1 * np.cos(ANGLE) - 0.05 * np.sin(ANGLE) + 0.03 * np.cos(2 * ANGLE) + 0.02 * np.sin(2 * ANGLE)
    )
    given = sectors(SECTOR_HEIGHTS, wave)
    for name in SECTOR_HEIGHTS[1 : 2 * missing + 1 : 2][:missing]:
        del given[name]
    found = summary("charge", given)
    expected = {"h_mean": 0.8, "h_c1": 0.1, "h_s1": -0.05, "h_c2": 0.03, "h_s2": 0.02}
    assert {k: found[k] for k in expected} == pytest.approx(expected)


def test_too_few_sectors_say_nothing() -> None:
    given = sectors(SECTOR_HEIGHTS, np.ones(24))
    for name in SECTOR_HEIGHTS[: 25 - LEAST_SECTORS]:
        del given[name]
    assert math.isnan(summary("charge", given)["h_mean"])


def test_sector_masses_are_shares() -> None:
    found = summary("charge", sectors(SECTOR_MASSES, 200.0 * (1.0 + 0.3 * np.cos(ANGLE))))
    assert found["ln_m_mean"] == pytest.approx(math.log(200.0))
    assert found["m_c1"] == pytest.approx(0.3) and found["m_s1"] == pytest.approx(0.0, abs=1e-12)


def cone(slope_deg: float, toe: float, dipole: float = 0.0) -> Surfaces:
    theta, r = (grid.ravel() for grid in np.meshgrid(np.arange(0.0, 360.0, 15.0), np.linspace(0.02, toe, 25)))
    height = (toe - r) * math.tan(math.radians(slope_deg)) + dipole * np.cos(np.radians(theta))
    return Surfaces(theta, r, height[None, :])


def test_a_cone_has_its_slope_toe_and_no_curvature() -> None:
    found = of_surface(cone(35.0, 0.6))
    assert found["slope"][0] == pytest.approx(35.0, abs=1e-6)
    assert found["toe"][0] == pytest.approx(0.6, abs=1e-6)
    assert found["curvature"][0] == pytest.approx(0.0, abs=1e-9)
    assert found["dipole_c"][0] == pytest.approx(0.0, abs=1e-9)


def test_a_tilted_cone_has_a_dipole() -> None:
    found = of_surface(cone(35.0, 0.6, 0.01))
    assert found["dipole_c"][0] == pytest.approx(0.01, abs=1e-9)
    assert found["dipole_s"][0] == pytest.approx(0.0, abs=1e-9)


SLOPE = math.tan(math.radians(35.0))


def lines_over_a_cone(azimuths: list[float], offset: tuple[float, float] = (0.0, 0.0)) -> Surfaces:
    """Scan lines from the axis outwards over a cone of 35 degrees whose summit stands at `offset`, m."""
    theta, r = (grid.ravel() for grid in np.meshgrid(azimuths, np.linspace(0.05, 0.5, 25)))
    x, y = r * np.cos(np.radians(theta)), r * np.sin(np.radians(theta))
    height = SLOPE * (0.6 - np.hypot(x - offset[0], y - offset[1]))
    return Surfaces(theta, r, height[None, :])


@pytest.mark.parametrize(
    ("azimuths", "told"),
    [
        ([0.0], ""),
        ([40.0], ""),
        ([0.0, 90.0], ""),
        ([0.0, 180.0], "c"),
        ([90.0, 270.0], "s"),
        ([30.0, 210.0], ""),
        ([0.0, 10.0, 20.0], ""),
        ([0.0, 60.0, 120.0], "c"),
        ([0.0, 90.0, 180.0], "cs"),
        ([0.0, 120.0, 240.0], "cs"),
        ([0.0, 90.0, 180.0, 270.0], "cs"),
    ],
)
def test_a_dipole_is_told_where_the_azimuths_tell_it(azimuths: list[float], told: str) -> None:
    centred, moved = (
        of_surface(lines_over_a_cone(azimuths, offset)) for offset in ((0.0, 0.0), (0.02, 0.01))
    )
    for axis, way in (("c", 0.02), ("s", 0.01)):
        if axis in told:
            assert centred[f"dipole_{axis}"][0] == pytest.approx(0.0, abs=1e-12)
            # Of a cone beside the axis: its slope times the way, to the first order of way over radius.
            assert moved[f"dipole_{axis}"][0] == pytest.approx(SLOPE * way, abs=0.15 * SLOPE * 0.02)
        else:
            assert math.isnan(centred[f"dipole_{axis}"][0]) and math.isnan(moved[f"dipole_{axis}"][0])
    # One line has a flank, whatever else it has not.
    assert centred["slope"][0] == pytest.approx(35.0) and centred["toe"][0] == pytest.approx(0.6)
    assert centred["curvature"][0] == pytest.approx(0.0, abs=1e-9)
    assert all(np.isfinite(moved[name][0]) for name in ("slope", "toe", "curvature"))


def test_a_line_through_the_axis_tells_its_own_way_exactly() -> None:
    found = of_surface(lines_over_a_cone([0.0, 180.0], (0.03, 0.0)))
    assert found["dipole_c"][0] == pytest.approx(SLOPE * 0.03, abs=1e-12)


def test_a_surface_scanned_all_around_keeps_its_bits() -> None:
    """The plain fit of all four columns, as stored runs were read."""
    theta, r = (np.tile((np.arange(24) + 0.5) * 15.0, 10), np.repeat((np.arange(10) + 0.5) * 0.03, 24))
    angle = np.radians(theta)
    ring = np.column_stack([np.ones(240), np.cos(angle), np.sin(angle), r])
    scatter = np.random.default_rng(5).normal(0.0, 0.01, (8, 240))
    heights = np.maximum(SLOPE * (0.28 - r) + 0.004 * np.cos(angle) + scatter, 0.0)
    found = of_surface(Surfaces(theta, r, heights))
    for k, h in enumerate(heights):
        wave = np.linalg.lstsq(ring, h, rcond=None)[0]
        assert (found["dipole_c"][k], found["dipole_s"][k]) == (wave[1], wave[2])


def test_a_surface_without_a_flank_says_nothing() -> None:
    flat = Surfaces(np.zeros(20), np.linspace(0.0, 1.0, 20), np.full((1, 20), 0.3))
    assert math.isnan(of_surface(flat)["slope"][0])
    few = Surfaces(np.zeros(3), np.linspace(0.0, 1.0, 3), np.ones((1, 3)))
    assert math.isnan(of_surface(few)["toe"][0])


def test_what_is_read_decides_which_summaries_there_are() -> None:
    assert of_observables(["repose_angle_deg", "mass_on_base_kg"]) == {"angle", "ln_mass"}
    assert of_observables([SURFACES]) == {"slope", "toe", "curvature", "dipole_c", "dipole_s"}
    assert not of_observables(SECTOR_HEIGHTS[: LEAST_SECTORS - 1])
    assert "h_c1" in of_observables(SECTOR_HEIGHTS[:LEAST_SECTORS])
    every = {name for test in OBSERVABLES_OF.values() for name in test} | {SURFACES}
    assert of_observables(every) == {name for names in NAMES.values() for name in names}

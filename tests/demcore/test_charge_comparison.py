"""Charges beside each other, and beside measured heights: expected values by hand."""

from __future__ import annotations

import math

import pytest

from demcore.errors import InputError
from demcore.experiments.charge_comparison import (
    NUMBERS,
    PlantProfile,
    against_plant,
    against_pressures,
    compare,
    number_of,
    read_heights,
    read_pressures,
)


def a_summary(far=1.5, near=1.0, share=0.6):
    """The numbers that these tests look at; the others are missing."""
    return {"findings": {"far_height_m": far, "near_height_m": near}, "far_share_of_mass": share}


def row(rows, name):
    return next(r for r in rows if r.name == name)


def test_a_difference_stands_beside_the_scatter_of_its_groups():
    """Means 1.5 and 1.2, standard deviations .1 of three each: noise sqrt(2 * .01 / 3) = .0816."""
    coke = [a_summary(far) for far in (1.4, 1.5, 1.6)]
    iron = [a_summary(far) for far in (1.1, 1.2, 1.3)]
    found = row(compare({"coke": coke, "iron": iron}), "far_height_m")
    assert found.unit == "m"
    assert found.groups["coke"] == pytest.approx((1.5, 0.1, 3))
    assert found.difference == pytest.approx(-0.3)
    assert found.noise == pytest.approx(0.0816, abs=1e-4)
    assert found.stands_out is True
    close = [a_summary(far) for far in (1.41, 1.52, 1.63)]
    assert row(compare({"a": coke, "b": close}), "far_height_m").stands_out is False


def test_one_charge_has_no_scatter_and_three_groups_no_difference():
    single = row(compare({"a": [a_summary()], "b": [a_summary(1.2)]}), "far_height_m")
    assert single.difference == pytest.approx(-0.3)
    assert math.isnan(single.noise) and single.stands_out is None
    three = row(compare({name: [a_summary()] for name in "abc"}), "far_height_m")
    assert math.isnan(three.difference)


def test_what_a_charge_does_not_have_is_left_out_of_its_group():
    found = row(compare({"a": [a_summary(None), a_summary(1.5)], "b": [{}]}), "far_height_m")
    assert found.groups["a"] == pytest.approx((1.5, math.nan, 1), nan_ok=True)
    assert found.groups["b"].charges == 0
    assert all(math.isnan(number_of({}, name)) for name in NUMBERS)
    with pytest.raises(InputError, match="groups of one charge or more"):
        compare({"a": []})


def test_heights_are_read_between_the_sectors_around_the_circle():
    """Four sectors at 45, 135, 225 and 315 degrees; at 0 degrees the mean of the last and the first."""
    summary = {
        "sectors": {"azimuth_deg": [45.0, 135.0, 225.0, 315.0], "height": [-1.0, -1.4, -1.0, -0.6]},
        "inputs": {"plant": {"hopper": {"seat_depth": 2.0}}},
    }
    measured = PlantProfile((45.0, 0.0, 135.0), (1.1, 1.1, 0.6))
    found = against_plant(summary, measured)
    assert found.here_m == pytest.approx((1.0, 1.2, 0.6))
    assert found.bias_m == pytest.approx(0.0)
    assert found.rms_m == pytest.approx(math.sqrt(0.02 / 3.0))
    assert found.correlation == pytest.approx(0.9449, abs=1e-4)
    assert math.isnan(against_plant(summary, PlantProfile((45.0,), (1.0,))).correlation)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "columns azimuth_deg and height_m"),
        ("azimuth_deg,level\n1,2\n", "columns azimuth_deg and height_m"),
        ("azimuth_deg,height_m\n", "at least one row"),
        ("azimuth_deg,height_m\n0,1\n15,high\n", "line 3, height_m: got 'high'"),
        ("azimuth_deg,height_m\n0\n", "line 2, height_m: got None"),
    ],
)
def test_a_table_that_cannot_be_read_is_refused(text, said):
    with pytest.raises(InputError, match=said):
        read_heights(text)


def test_a_table_of_heights_is_read_whatever_else_it_holds():
    found = read_heights("note,azimuth_deg,height_m\nnorth,-90,1.5\nsouth,90,0.5\n")
    assert found == PlantProfile((270.0, 90.0), (1.5, 0.5))


def around(*heights):
    """A charge with so many sectors, its heights given above the bell's seat."""
    n = len(heights)
    return {
        "sectors": {
            "azimuth_deg": [360.0 * (k + 0.5) / n for k in range(n)],
            "height": [h - 2.0 for h in heights],
        },
        "inputs": {"plant": {"hopper": {"seat_depth": 2.0}}},
    }


def taps(*pressures):
    return PlantProfile(tuple(360.0 * (k + 0.5) / len(pressures) for k in range(len(pressures))), pressures)


def test_taps_are_compared_by_rank_whatever_their_scale():
    """Pressures that rise with height, bent: ranks agree wholly, and of six turnings one does."""
    charge = around(0.2, 0.5, 0.9, 1.4, 1.0, 0.4)
    found = against_pressures(charge, taps(*(h**3 + 7.0 for h in (0.2, 0.5, 0.9, 1.4, 1.0, 0.4))))
    assert found.rank_correlation == pytest.approx(1.0)
    assert found.as_strong_when_turned == pytest.approx(1.0 / 6.0)
    assert found.here_m == pytest.approx((0.2, 0.5, 0.9, 1.4, 1.0, 0.4))
    falling = against_pressures(charge, taps(*(5.0 - h for h in (0.2, 0.5, 0.9, 1.4, 1.0, 0.4))))
    assert falling.rank_correlation == pytest.approx(-1.0)
    assert falling.as_strong_when_turned == pytest.approx(1.0 / 6.0)


def test_a_pressure_with_the_same_shape_elsewhere_is_seen_by_turning():
    """The same profile turned by two of eight taps: here the ranks agree weakly, and most turnings do better."""
    heights = (1.0, 1.1, 1.3, 1.6, 2.0, 1.7, 1.4, 1.2)
    found = against_pressures(around(*heights), taps(*heights[2:], *heights[:2]))
    assert abs(found.rank_correlation) < 0.5
    assert found.as_strong_when_turned > 0.3


def test_taps_come_in_any_order_and_equal_ranks_share_their_mean():
    """Spearman by hand: ranks 1, 2.5, 2.5, 4 against 1, 2, 3, 4 is 4.5 / sqrt(4.5 * 5)."""
    charge = around(0.1, 0.2, 0.2, 0.3)
    measured = taps(10.0, 20.0, 30.0, 40.0)
    found = against_pressures(charge, measured)
    assert found.rank_correlation == pytest.approx(4.5 / math.sqrt(4.5 * 5.0))
    mixed = PlantProfile(measured.azimuth_deg[::-1], measured.value[::-1])
    again = against_pressures(charge, mixed)
    assert again.rank_correlation == pytest.approx(found.rank_correlation)
    assert again.here_m == pytest.approx((0.3, 0.2, 0.2, 0.1)), "in the order of the table"


def test_a_level_burden_or_equal_taps_say_nothing():
    for charge, measured in (
        (around(1.0, 1.0, 1.0, 1.0), taps(1, 2, 3, 4)),
        (around(1, 2, 3, 4), taps(5, 5, 5, 5)),
    ):
        found = against_pressures(charge, measured)
        assert math.isnan(found.rank_correlation) and math.isnan(found.as_strong_when_turned)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("azimuth_deg,height_m\n0,1\n", "plant_pressures: .* columns azimuth_deg and pressure_kpa"),
        ("azimuth_deg,pressure_kpa\n0,1\n90,2\n180,3\n", "got '3 rows', allowed is at least 4 rows"),
        ("azimuth_deg,pressure_kpa\n0,1\n90,nan\n", "plant_pressures, line 3, pressure_kpa"),
    ],
)
def test_a_table_of_taps_that_cannot_be_read_is_refused(text, said):
    with pytest.raises(InputError, match=said):
        read_pressures(text)

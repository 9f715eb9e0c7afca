"""Predicted and measured side by side."""

from __future__ import annotations

import pytest

from service.domain.explanation import compare


def test_the_surprise_counts_noise_and_doubt_together() -> None:
    """sqrt(.3^2 + .4^2) = .5, so 26.0 lies two of them above 25.0; 1.645 of them hold 90 %."""
    (told,) = compare({"mean_deg": 25.0, "sd_deg": 0.3}, {"noise_sd_deg": 0.4}, {"angle_deg": 26.0})
    assert (told.observable, told.unit, told.noise_sd) == ("angle_deg", "deg", 0.4)
    assert told.z == pytest.approx(2.0)
    assert told.inside_90 is False
    assert told.interval_90 == pytest.approx((25.0 - 0.822427, 25.0 + 0.822427), abs=1e-6)


def test_every_response_with_its_own_noise() -> None:
    prediction = {
        "responses": {
            "angle_deg": {"unit": "deg", "mean": 25.0, "sd": 0.5},
            "mass_on_base_kg": {"unit": "kg", "mean": 10.0, "sd": 3.0},
        },
        "ok_probability": 0.9,
    }
    fits = {"angle_deg": {"noise_sd": 0.0}, "mass_on_base_kg": {"noise_sd": 4.0}}
    angle, mass = compare(prediction, fits, {"angle_deg": 25.5, "mass_on_base_kg": 7.5})
    assert (angle.z, angle.inside_90) == (1.0, True)
    assert (mass.z, mass.inside_90, mass.unit) == (-0.5, True, "kg")


def test_before_the_result_and_without_a_prediction() -> None:
    (waiting,) = compare({"mean_deg": 25.0, "sd_deg": 0.3}, None, None)
    assert (waiting.measured, waiting.z, waiting.inside_90, waiting.noise_sd) == (None, None, None, None)
    assert compare(None, None, {"angle_deg": 25.0}) == ()

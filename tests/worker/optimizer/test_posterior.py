"""Posterior and sensitivity where the answer is known: one variable decides, the other does nothing."""

from __future__ import annotations

import numpy as np
import pytest

from tests.worker.optimizer.studies import at, space, spec_of
from worker.optimizer.history import Design, History
from worker.optimizer.posterior import interval, label, posterior
from worker.optimizer.sensitivity import sensitivity

SPEC = spec_of(space(2, None), 30.0, 1.0)


def linear_history() -> History:
    """angle = 20 + 20 u_1, free of noise, on a 5 x 5 grid: target 30 +- 1 means u_1 = .5 +- .05."""
    grid = [(a, b) for a in np.linspace(0, 1, 5) for b in np.linspace(0, 1, 5)]
    designs = (
        Design(i + 1, (float(a), float(b)), i, at(20.0 + 20.0 * float(a)), "doe")
        for i, (a, b) in enumerate(grid)
    )
    return History(tuple(designs))


def test_posterior_identifies_what_decides_and_leaves_the_rest() -> None:
    found = posterior(SPEC, linear_history(), points=8192)
    assert found is not None
    first, second = found.parameters
    assert (first.label, second.label) == ("identified", "not identified")
    assert first.mean == pytest.approx(0.5, abs=0.01)
    assert first.lower_90 < 0.5 < first.upper_90
    assert first.upper_90 - first.lower_90 < 0.2
    assert second.sd_ratio == pytest.approx(1.0, abs=0.1)
    assert (second.lower_90, second.upper_90) == (
        pytest.approx(0.05, abs=0.03),
        pytest.approx(0.95, abs=0.03),
    )


def test_share_within_two_sigma_is_the_window_widened_by_the_emulator() -> None:
    """Alone the window (2 sigma) would be 2 deg of 20: .1; the emulator's sd of about .25 adds a little."""
    found = posterior(SPEC, linear_history(), points=8192)
    assert found is not None
    assert 0.08 < found.share_within_2_sigma < 0.16


def test_labels_at_their_limits() -> None:
    assert [label(v) for v in (0.34, 0.35, 0.8, 0.81)] == ["identified", "weak", "weak", "not identified"]


def test_weighted_interval_of_a_uniform_sample() -> None:
    values = np.linspace(0.0, 1.0, 1001)
    lower, upper = interval(values, np.full(1001, 1 / 1001), 0.9)
    assert (lower, upper) == (pytest.approx(0.05, abs=0.002), pytest.approx(0.95, abs=0.002))


def test_sensitivity_of_a_response_that_one_variable_decides() -> None:
    found = sensitivity(SPEC, linear_history())
    assert found is not None
    first, second = found
    assert first.variance_share == pytest.approx(1.0, abs=0.05)
    assert second.variance_share < 0.02
    assert first.rank_correlation > 0.98
    assert first.swing_deg == pytest.approx(20.0 * 10 / 11, abs=0.5)
    assert abs(second.swing_deg) < 0.5


def test_nothing_is_known_before_an_angle() -> None:
    assert posterior(SPEC, History()) is None
    assert sensitivity(SPEC, History()) is None

"""Closed forms against Monte Carlo (2 million normals: standard errors under .002 deg)."""

from __future__ import annotations

import numpy as np
import pytest

from service.domain.study import Response
from worker.optimizer.acquisition import (
    certifiable_means,
    certificate_chance,
    effort,
    expected_improvement,
    expected_miss,
    minimum_improvement,
    window_probability,
)

NORMALS = np.random.default_rng(7).standard_normal(2_000_000)
POINTS = [(30.0, 1.0), (31.3, 0.4), (27.0, 2.5), (30.2, 0.05)]
TARGET = 30.0


def one(value: float) -> np.ndarray:
    return np.array([value])


@pytest.mark.parametrize(("m", "s"), POINTS)
def test_expected_miss_is_the_monte_carlo_mean(m: float, s: float) -> None:
    sampled = np.mean(np.abs(m + s * NORMALS - TARGET))
    assert expected_miss(one(m), one(s), TARGET)[0] == pytest.approx(sampled, abs=0.005)


@pytest.mark.parametrize(("m", "s"), POINTS)
@pytest.mark.parametrize("b", [0.3, 1.5])
def test_expected_improvement_is_the_monte_carlo_mean(m: float, s: float, b: float) -> None:
    sampled = np.mean(np.maximum(0.0, b - np.abs(m + s * NORMALS - TARGET)))
    assert expected_improvement(one(m), one(s), TARGET, b)[0] == pytest.approx(sampled, abs=0.003)


def test_minimum_improvement_is_the_monte_carlo_mean() -> None:
    sampled = np.mean(np.maximum(0.0, 1.2 - (2.0 + 1.5 * NORMALS)))
    assert minimum_improvement(one(2.0), one(1.5), 1.2)[0] == pytest.approx(sampled, abs=0.003)


def test_window_probability_of_one_sd_is_683_in_1000() -> None:
    assert window_probability(one(30.0), one(1.0), (29.0, 31.0))[0] == pytest.approx(0.6827, abs=1e-4)


@pytest.mark.parametrize("s", [0.05, 0.12, 0.18, 0.25, 0.29])
def test_certifiable_means_are_where_the_certificate_begins(s: float) -> None:
    response = Response("angle_deg", 30.0, (29.2, 30.8), 0.5)
    lower, upper = (float(v[0]) for v in certifiable_means(one(s), response))
    for mean, inwards in ((lower, 1.0), (upper, -1.0)):
        assert holds(mean + 0.01 * inwards, s, response)
        assert not holds(mean - 0.01 * inwards, s, response)


def holds(mean: float, s: float, response: Response) -> bool:
    near = window_probability(one(mean), one(s), (29.5, 30.5))[0] >= 0.85
    return bool(near and window_probability(one(mean), one(s), response.window)[0] >= 0.99)


def test_no_mean_is_certifiable_when_the_sd_is_too_large() -> None:
    lower, upper = certifiable_means(one(0.5), Response("angle_deg", 30.0, (29.2, 30.8), 0.5))
    assert upper[0] < lower[0]


def test_certificate_chance_is_the_monte_carlo_share_of_certified_futures() -> None:
    """Draw a truth from the posterior, three noisy runs of it, update by Bayes: how often does it certify?"""
    response, m, s, sigma, r = Response("angle_deg", 30.0, (28.5, 31.5), 0.5), 30.2, 0.6, 0.5, 3
    rng = np.random.default_rng(3)
    truth = m + s * rng.standard_normal(200_000)
    mean_of_runs = truth + sigma / np.sqrt(r) * rng.standard_normal(200_000)
    s_r = (s**-2 + r * sigma**-2) ** -0.5
    updated = s_r**2 * (m / s**2 + r * mean_of_runs / sigma**2)
    lower, upper = certifiable_means(one(s_r), response)
    share = np.mean((updated >= lower[0]) & (updated <= upper[0]))
    found = certificate_chance(one(m), one(s), r, sigma, 1.0, response)[0]
    assert 0.05 < share < 0.95
    assert found == pytest.approx(share, abs=0.005)


def test_effort_counts_the_seeds_that_are_missing() -> None:
    """A posterior that is certain needs exactly the missing seeds, and none of it is left to chance."""
    response = Response("angle_deg", 30.0, (28.5, 31.5), 0.5)
    need, chance = effort(
        np.full(3, 30.0), np.full(3, 1e-3), np.array([1.0, 2.0, 3.0]), 9, 0.5, 1.0, response
    )
    assert need == pytest.approx([1.0, 2.0, 3.0])
    assert chance == pytest.approx(1.0)

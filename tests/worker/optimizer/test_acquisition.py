"""Closed forms against Monte Carlo (2 million normals: standard errors under .002 deg)."""

from __future__ import annotations

import numpy as np
import pytest

from service.domain.study import Response
from worker.optimizer.acquisition import (
    Course,
    certifiable_means,
    certificate_chance,
    counting_sd,
    effort,
    expected_improvement,
    expected_miss,
    joint_improvement,
    joint_miss,
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
    found = certificate_chance([Course(response, one(m), one(s), sigma, 1.0)], r)[0]
    assert 0.05 < share < 0.95
    assert found == pytest.approx(share, abs=0.005)


def test_effort_counts_the_seeds_that_are_missing() -> None:
    """A posterior that is certain needs exactly the missing seeds, and none of it is left to chance."""
    response = Response("angle_deg", 30.0, (28.5, 31.5), 0.5)
    sure = Course(response, np.full(3, 30.0), np.full(3, 1e-3), 0.5, 1.0)
    need, chance = effort([sure], np.array([1.0, 2.0, 3.0]), 9)
    assert need == pytest.approx([1.0, 2.0, 3.0])
    assert chance == pytest.approx(1.0)


def test_no_plan_for_what_lies_too_far_or_lacks_more_seeds_than_are_left() -> None:
    response = Response("angle_deg", 30.0, (28.5, 31.5), 0.5)
    course = Course(response, np.array([90.0, 30.0]), np.array([0.1, 0.1]), 0.5, 1.0)
    need, chance = effort([course], np.array([1.0, 9.0]), 8)
    assert need.tolist() == [np.inf, np.inf]
    assert chance.tolist() == [0.0, 0.0]


TWO = np.array([[30.0, 31.0, 34.0], [4.0, 5.0, 4.5]]), np.array([[0.6, 0.4, 1.0], [0.3, 0.2, 0.5]])
TARGETS, TAUS = np.array([30.5, 4.4]), np.array([0.75, 0.25])


def test_one_response_by_the_fixed_normals_is_the_closed_form() -> None:
    m, s = np.array([29.0, 30.0, 31.5]), np.array([0.4, 0.8, 1.2])
    tau = np.array([0.5])
    miss = joint_miss(m[None], s[None], np.array([30.0]), tau)
    assert tau * miss == pytest.approx(expected_miss(m, s, 30.0), abs=0.01)
    gain = joint_improvement(m[None], s[None], np.array([30.0]), tau, 1.2)
    assert tau * gain == pytest.approx(expected_improvement(m, s, 30.0, 0.6), abs=0.01)


def test_several_responses_against_plain_monte_carlo() -> None:
    z = np.random.default_rng(1).standard_normal((200_000, 2, 1))
    chi = np.sqrt(np.sum(((TWO[0] + z * TWO[1] - TARGETS[:, None]) / TAUS[:, None]) ** 2, axis=1))
    assert joint_miss(*TWO, TARGETS, TAUS) == pytest.approx(chi.mean(axis=0), rel=0.01)
    expected = np.maximum(1.5 - chi, 0.0).mean(axis=0)
    assert joint_improvement(*TWO, TARGETS, TAUS, 1.5) == pytest.approx(expected, abs=0.01)


def test_a_response_counts_with_the_labs_sd_and_a_quarter_of_its_window() -> None:
    assert counting_sd(Response("angle_deg", 30.0, (28.4, 31.6), 0.5, 0.6)) == pytest.approx(1.0)


def test_a_certificate_of_two_responses_has_the_chance_of_both() -> None:
    angle = Response("angle_deg", 30.0, (28.5, 31.5), 0.5)
    mass = Response("mass_on_base_kg", 4.0, (3.0, 5.0), 0.3)
    courses = [Course(angle, one(30.2), one(0.6), 0.5, 1.0), Course(mass, one(4.1), one(0.4), 0.2, 1.0)]
    alone = [certificate_chance([course], 4)[0] for course in courses]
    both = certificate_chance(courses, 4)[0]
    # The windows are wide here, so that sharing the .99 between them changes nothing.
    assert both == pytest.approx(alone[0] * alone[1], abs=1e-3)
    assert 0.05 < both < min(alone)

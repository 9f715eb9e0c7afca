"""Bayes factors against direct integration, the quadrant against scipy, blocks against the full determinant."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import dblquad, quad
from scipy.stats import multivariate_normal, norm

from tests.worker.diagnosis.plants import normals
from worker.diagnosis import unexplained
from worker.diagnosis.evidence import log_bayes_pairs, log_bayes_single, quadrant, whiten
from worker.diagnosis.unexplained import SIZES, Block


def half_normal(a: float, tau: float) -> float:
    return 2.0 * float(norm.pdf(a, scale=tau))


@pytest.mark.parametrize(
    ("q", "s", "tau"), [(3.0, 4.0, 0.5), (-2.0, 4.0, 0.5), (0.0, 9.0, 2.0), (12.0, 9.0, 1.0)]
)
def test_one_effect_is_the_integral_over_its_amplitude(q: float, s: float, tau: float) -> None:
    direct, _ = quad(lambda a: math.exp(q * a - 0.5 * s * a * a) * half_normal(a, tau), 0.0, 12.0 * tau)
    found = log_bayes_single(np.array([q]), np.array([s]), np.array([tau]))
    assert found[0] == pytest.approx(math.log(direct), abs=1e-6)


def test_one_effect_far_on_the_wrong_side_is_finite() -> None:
    """scipy's log_ndtr holds where the normal itself would underflow."""
    found = log_bayes_single(np.array([-400.0]), np.array([4.0]), np.array([1.0]))
    assert np.isfinite(found[0]) and found[0] < 0.0


@pytest.mark.parametrize(
    ("q", "cross", "tau"),
    [((3.0, 2.0), 0.5, (0.5, 1.0)), ((4.0, 4.0), 3.0, (1.0, 1.0)), ((5.0, -0.5), -2.0, (0.7, 0.4))],
)
def test_two_effects_are_the_double_integral(
    q: tuple[float, float], cross: float, tau: tuple[float, float]
) -> None:
    S = np.array([[4.0, cross], [cross, 5.0]])

    def integrand(b: float, a: float) -> float:
        x = np.array([a, b])
        return (
            math.exp(float(np.dot(q, x) - 0.5 * x @ S @ x)) * half_normal(a, tau[0]) * half_normal(b, tau[1])
        )

    direct, _ = dblquad(integrand, 0.0, 8.0 * tau[0], 0.0, 8.0 * tau[1], epsabs=1e-8)
    found = log_bayes_pairs(np.array(q), S, np.array(tau)).log_bayes
    assert found[0, 1] == pytest.approx(math.log(direct), abs=1e-4)
    assert found[0, 1] == pytest.approx(found[1, 0])


def test_a_pair_of_two_wrong_signs_is_left_out() -> None:
    found = log_bayes_pairs(np.array([-9.0, -9.0]), np.array([[4.0, 0.0], [0.0, 4.0]]), np.array([1.0, 1.0]))
    assert found.log_bayes[0, 1] == -np.inf


@pytest.mark.parametrize("rho", [-0.99, -0.6, 0.0, 0.3, 0.95])
@pytest.mark.parametrize(("h", "k"), [(0.0, 0.0), (1.5, -0.5), (-1.0, -1.8), (3.0, 0.2)])
def test_the_quadrant_is_the_bivariate_normal(h: float, k: float, rho: float) -> None:
    expected = multivariate_normal.cdf([h, k], mean=[0.0, 0.0], cov=[[1.0, rho], [rho, 1.0]])
    found = quadrant(np.array([h]), np.array([k]), np.array([rho]))
    assert found[0] == pytest.approx(float(expected), abs=2e-5)


def test_blocks_are_ratios_of_full_normal_densities() -> None:
    root = normals(1, 9, 9)
    V, r, d = root @ root.T + np.eye(9), normals(2, 9) * 3.0, np.linspace(0.5, 2.0, 9)
    B = np.zeros((9, 2))
    B[2, 0], B[5, 0], B[7, 1] = 1.0, 1.0, 1.0
    found = unexplained.log_bayes((Block("test", "x", B),), d, whiten(r, V))
    K = (d[:, None] * B) @ (d[:, None] * B).T
    zero = np.zeros(9)
    base = multivariate_normal.logpdf(r, zero, V)
    direct = [multivariate_normal.logpdf(r, zero, V + t * t * K) - base for t in SIZES]
    assert found[0] == pytest.approx(float(np.logaddexp.reduce(direct) - math.log(len(SIZES))))

"""P(ok): sane without failures, sharp where failures are, and its mode a true stationary point."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import expit

from worker.optimizer.crashes import MU, CrashClassifier, _kernel, _mode

CUBE = np.random.default_rng(1).random((40, 3))


def test_without_failures_every_design_probably_runs() -> None:
    p = CrashClassifier(CUBE[:5], np.ones(5)).ok_probability(CUBE)
    assert np.all(p > 0.6)
    assert np.all(p < 1.0)


def test_mode_satisfies_its_equation_even_when_newton_overshoots() -> None:
    """At the mode, weights = ran - logistic(mu + K weights) (Rasmussen and Williams 2006, eq. 3.17)."""
    ran = (CUBE[:12].sum(axis=1) > 1.4).astype(float)
    kernel = _kernel(CUBE[:12] - 0.5, CUBE[:12] - 0.5)
    weights = _mode(kernel, ran)
    assert weights == pytest.approx(ran - expit(MU + kernel @ weights), abs=1e-4)


def test_a_corner_that_crashes_is_learned() -> None:
    ran = (CUBE[:, 0] + CUBE[:, 1] > 0.8).astype(float)
    assert 5 < np.sum(ran == 0.0) < 20
    p = CrashClassifier(CUBE, ran).ok_probability(
        np.array([[0.1, 0.1, 0.5], [0.9, 0.9, 0.5], [0.4, 0.4, 0.5]])
    )
    assert p[0] < 0.15
    assert p[1] > 0.9
    assert p[0] < p[2] < p[1]


def test_one_failure_is_felt_nearby_and_hardly_far_off() -> None:
    u = np.array([[0.1, 0.1, 0.1], [0.9, 0.9, 0.9], [0.5, 0.5, 0.5]])
    p = CrashClassifier(u, np.array([0.0, 1.0, 1.0])).ok_probability(
        np.array([[0.12, 0.1, 0.1], [0.9, 0.8, 0.9]])
    )
    assert p[0] < 0.5 < 0.85 < p[1]


def test_everything_failed() -> None:
    assert np.all(CrashClassifier(CUBE[:4], np.zeros(4)).ok_probability(CUBE[:4]) < 0.4)

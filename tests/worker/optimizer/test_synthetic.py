"""The synthetic rig against its formula."""

from __future__ import annotations

import numpy as np
import pytest

from worker.optimizer.synthetic import SyntheticRig, crash_probability, true_angle


def test_the_synthetic_angle_by_hand() -> None:
    """pp = .2, pw = .3, e = .1, r = .25: 14.5 + 9 S(1) + 18 S(1) S(2/3) + 1.5 S(1)."""
    s1, s23 = 1.0 - np.exp(-1.0), 1.0 - np.exp(-2.0 / 3.0)
    expected = 14.5 + 9.0 * s1 + 18.0 * s1 * s23 + 1.5 * s1
    assert true_angle(np.array([[0.2, 0.3, 0.1, 0.25]]))[0] == pytest.approx(expected)


def test_a_tenth_of_the_synthetic_space_crashes() -> None:
    u = np.random.default_rng(0).random((100_000, 4))
    x = np.array([0.1, 0.1, 0.1, 0.05]) + u * np.array([0.8, 0.8, 0.5, 0.55])
    assert np.mean(crash_probability(x)) == pytest.approx(0.096, abs=0.004)


def test_the_rig_answers_the_same_to_the_same_question() -> None:
    rig, x = SyntheticRig(), (0.5, 0.5, 0.3, 0.3)
    assert rig.run(x, 1) == rig.run(x, 1) != rig.run(x, 2)
    sample = [(rig.run(x, seed) or {})["angle_deg"] for seed in range(400)]
    assert np.std(sample) == pytest.approx(0.5, abs=0.06)


def test_another_test_is_linear_in_the_angle_but_for_its_wave() -> None:
    """At pp = .2, pw = .3, e = .1, r = .05 the wave's argument is 0."""
    x = np.array([[0.2, 0.3, 0.1, 0.05]])
    other = SyntheticRig(ratio=1.1, shift_deg=2.0, wave_deg=5.0)
    assert other.mean(x) == pytest.approx(32.0 + 1.1 * (true_angle(x) - 30.0))

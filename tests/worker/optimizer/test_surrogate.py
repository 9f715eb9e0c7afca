"""The Gaussian process against dense linear algebra written out here, and against refits without a point."""

from __future__ import annotations

import numpy as np
import pytest

from worker.optimizer.surrogate import (
    TREND_SLOPE_DEG,
    Hyperparameters,
    Surrogate,
    TrainingSet,
    fit_hyperparameters,
    training_set,
)

HYPER = Hyperparameters(3.0, (0.6, 1.5), 0.5, 29.0)


def some_data(count: int = 9) -> TrainingSet:
    rng = np.random.default_rng(5)
    u = rng.random((count, 2))
    y = 24.0 + 12.0 * np.sqrt(u[:, 0]) + 2.0 * u[:, 1] + 0.3 * rng.standard_normal(count)
    return TrainingSet(u, y, np.where(np.arange(count) % 3 == 0, 3.0, 1.0))


def kernel(u: np.ndarray, w: np.ndarray) -> np.ndarray:
    """a^2 (1 + sqrt5 r + 5/3 r^2) exp(-sqrt5 r) + w^2 (1/4 + v.v'), straight from the docstring."""
    r = np.sqrt((((u[:, None] - w[None]) / np.array(HYPER.length_scales)) ** 2).sum(-1))
    matern = (1.0 + np.sqrt(5.0) * r + 5.0 / 3.0 * r**2) * np.exp(-np.sqrt(5.0) * r)
    return HYPER.amplitude_deg**2 * matern + TREND_SLOPE_DEG**2 * (0.25 + (u - 0.5) @ (w - 0.5).T)


def test_posterior_is_the_textbook_formula_and_its_sd_leaves_the_noise_out() -> None:
    data, at = some_data(), np.array([[0.2, 0.7], [0.95, 0.1]])
    big = kernel(data.u, data.u) + np.diag(0.25 / data.n)
    cross = kernel(at, data.u)
    mean = 29.0 + cross @ np.linalg.solve(big, data.y - 29.0)
    variance = np.diag(kernel(at, at) - cross @ np.linalg.solve(big, cross.T))
    found_mean, found_sd = Surrogate(data, HYPER).predict(at)
    assert found_mean == pytest.approx(mean, abs=1e-8)
    assert found_sd == pytest.approx(np.sqrt(variance), abs=1e-8)


def test_leave_one_out_is_the_refit_without_each_design() -> None:
    data = some_data()
    brute = []
    for i in range(len(data.y)):
        rest = TrainingSet(*(np.delete(part, i, axis=0) for part in data))
        mean, sd = Surrogate(rest, HYPER).predict(data.u[i : i + 1])
        brute.append((data.y[i] - mean[0]) / np.sqrt(sd[0] ** 2 + 0.25 / data.n[i]))
    assert Surrogate(data, HYPER).loo_z == pytest.approx(brute, abs=1e-8)


def test_inflation_is_never_below_one_and_follows_the_scatter_of_z() -> None:
    data = some_data()
    calm = Surrogate(data, HYPER)
    wild = Surrogate(data._replace(y=29.0 + 5.0 * (data.y - 29.0)), HYPER)
    assert calm.inflation >= 1.0
    assert wild.inflation == pytest.approx(np.std(wild.loo_z))
    assert wild.inflation > 1.5


def test_runs_at_one_design_enter_as_their_mean() -> None:
    data = training_set([((0.1,), 20.0), ((0.5,), 25.0), ((0.1,), 22.0)])
    assert data.y == pytest.approx([21.0, 25.0])
    assert data.n == pytest.approx([2.0, 1.0])


def test_more_runs_condition_as_if_they_had_been_there() -> None:
    rows = [((0.1, 0.2), 20.0), ((0.8, 0.5), 30.0), ((0.5, 0.9), 26.0)]
    more = [((0.1, 0.2), 22.0), ((0.3, 0.3), 23.0)]
    at = np.array([[0.4, 0.4]])
    whole = Surrogate(training_set(rows + more), HYPER).predict(at)
    grown = Surrogate(training_set(rows), HYPER).with_runs(more).predict(at)
    assert grown[0] == pytest.approx(whole[0])
    assert grown[1] == pytest.approx(whole[1])


def test_fit_is_stable_with_five_points_and_with_equal_angles() -> None:
    u = np.random.default_rng(2).random((5, 4))
    for y in (np.full(5, 30.0), 30.0 + 10.0 * (u[:, 0] - 0.5)):
        hyper = fit_hyperparameters(TrainingSet(u, y, np.ones(5)), 0.5)
        mean, sd = Surrogate(TrainingSet(u, y, np.ones(5)), hyper).predict(u)
        assert mean == pytest.approx(y, abs=0.5)
        assert np.all(sd < 0.6)


def test_fit_finds_which_variable_bends_the_response() -> None:
    u = np.random.default_rng(4).random((25, 2))
    y = 30.0 + 4.0 * np.sin(6.0 * u[:, 0])
    hyper = fit_hyperparameters(TrainingSet(u, y, np.ones(25)), 0.2)
    assert hyper.length_scales[0] < 0.5 * hyper.length_scales[1]


def test_hyperparameters_survive_json() -> None:
    assert Hyperparameters.from_dict(HYPER.as_dict()) == HYPER

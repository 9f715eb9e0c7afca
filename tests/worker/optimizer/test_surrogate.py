"""The Gaussian process against dense linear algebra written out here, and against refits without a point."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, DotProduct, Matern, WhiteKernel

from worker.optimizer.noise import NoiseEvidence
from worker.optimizer.surrogate import (
    Hyperparameters,
    Surrogate,
    TrainingSet,
    fit_hyperparameters,
    training_set,
)

HYPER = Hyperparameters(3.0, (0.6, 1.5), 0.5, 29.0, 8.0)


def known(sd: float) -> NoiseEvidence:
    """A noise that the data cannot argue with."""
    return NoiseEvidence(1e6, 1e6 * sd**2)


def some_data(count: int = 9) -> TrainingSet:
    rng = np.random.default_rng(5)
    u = rng.random((count, 2))
    y = 24.0 + 12.0 * np.sqrt(u[:, 0]) + 2.0 * u[:, 1] + 0.3 * rng.standard_normal(count)
    return TrainingSet(u, y, np.where(np.arange(count) % 3 == 0, 3.0, 1.0))


def kernel(u: np.ndarray, w: np.ndarray) -> np.ndarray:
    """a^2 (1 + sqrt5 r + 5/3 r^2) exp(-sqrt5 r) + w^2 (1/4 + v.v'), straight from the docstring."""
    r = np.sqrt((((u[:, None] - w[None]) / np.array(HYPER.length_scales)) ** 2).sum(-1))
    matern = (1.0 + np.sqrt(5.0) * r + 5.0 / 3.0 * r**2) * np.exp(-np.sqrt(5.0) * r)
    return HYPER.amplitude**2 * matern + HYPER.slope**2 * (0.25 + (u - 0.5) @ (w - 0.5).T)


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
        hyper = fit_hyperparameters(TrainingSet(u, y, np.ones(5)), known(0.5))
        mean, sd = Surrogate(TrainingSet(u, y, np.ones(5)), hyper).predict(u)
        assert mean == pytest.approx(y, abs=0.5)
        assert np.all(sd < 0.6)


def test_fit_finds_which_variable_bends_the_response() -> None:
    u = np.random.default_rng(4).random((25, 2))
    y = 30.0 + 4.0 * np.sin(6.0 * u[:, 0])
    hyper = fit_hyperparameters(TrainingSet(u, y, np.ones(25)), known(0.2))
    assert hyper.length_scales[0] < 0.5 * hyper.length_scales[1]


def test_hyperparameters_survive_json() -> None:
    assert Hyperparameters.from_dict(HYPER.as_dict()) == HYPER


def test_the_fit_is_a_maximum_of_likelihood_times_priors() -> None:
    """scikit-learn's own likelihood (with WhiteKernel as the noise) and priors written out."""
    data = TrainingSet(*some_data()[:2], np.ones(9))
    evidence = NoiseEvidence(4.0, 4.0 * 0.5**2)
    found = fit_hyperparameters(data, evidence)

    def log_posterior(amplitude: float, lengths: tuple[float, ...], noise: float) -> float:
        kernel = (
            ConstantKernel(amplitude**2) * Matern(lengths, nu=2.5)
            + ConstantKernel(64.0) * DotProduct(0.5)
            + WhiteKernel(noise**2)
        )
        gp = GaussianProcessRegressor(kernel, alpha=0.0, optimizer=None).fit(
            data.u - 0.5, data.y - data.y.mean()
        )
        z = np.log([amplitude / 5.0, *lengths]) / 0.5
        scatter = -2.0 * np.log(noise**2) - 0.5 * 4.0 * 0.5**2 / noise**2
        return float(gp.log_marginal_likelihood_value_ - 0.5 * z @ z + scatter)

    best = log_posterior(found.amplitude, found.length_scales, found.noise_sd)
    for factor in (0.9, 1.1):
        first, second = found.length_scales
        for other in (
            (found.amplitude * factor, (first, second), found.noise_sd),
            (found.amplitude, (first * factor, second), found.noise_sd),
            (found.amplitude, (first, second * factor), found.noise_sd),
            (found.amplitude, (first, second), found.noise_sd * factor),
        ):
            assert log_posterior(*other) < best


@pytest.mark.parametrize("sd", [0.3, 1.5])
def test_the_noise_is_read_from_designs_about_a_smooth_surface(sd: float) -> None:
    """Thirty designs without a replicate; the prior says 0.5 deg with the weight of four."""
    rng = np.random.default_rng(8)
    u = rng.random((30, 2))
    y = 20.0 + 12.0 * u[:, 0] + 3.0 * u[:, 1] ** 2 + sd * rng.standard_normal(30)
    found = fit_hyperparameters(TrainingSet(u, y, np.ones(30)), NoiseEvidence(4.0, 1.0))
    assert found.noise_sd == pytest.approx(sd, rel=0.35)


def test_a_response_in_other_units_is_the_same_fit() -> None:
    data = some_data()
    angle = fit_hyperparameters(data, NoiseEvidence(4.0, 1.0))
    gram = fit_hyperparameters(data._replace(y=1000.0 * data.y), NoiseEvidence(4.0, 1e6), unit=1000.0)
    assert gram.amplitude == pytest.approx(1000.0 * angle.amplitude, rel=1e-4)
    assert gram.noise_sd == pytest.approx(1000.0 * angle.noise_sd, rel=1e-4)
    assert gram.length_scales == pytest.approx(angle.length_scales, rel=1e-4)

"""The emulator on functions that are known: values, slopes, noise and honest bands."""

from __future__ import annotations

import numpy as np
import pytest

from tests.worker.diagnosis.plants import normals
from worker.diagnosis.emulator import fit
from worker.diagnosis.simulator import FloatArray
from worker.optimizer.design import sobol


def truth(u: FloatArray) -> FloatArray:
    """A quadratic, one that saturates, and a constant."""
    quadratic = 3.0 + 2.0 * u[:, 0] - u[:, 1] ** 2 + u[:, 0] * u[:, 2]
    saturating = 10.0 * (1.0 - np.exp(-3.0 * u[:, 1])) * u[:, 2]
    return np.column_stack([quadratic, saturating, np.full(len(u), 5.0)])


def test_values_and_slopes_of_noiseless_functions() -> None:
    u, new = sobol(3, 80, 1), sobol(3, 32, 2)
    emulator = fit(u, truth(u))
    mean, variance = emulator.predict(new)
    assert np.max(np.abs(mean - truth(new)), axis=0) == pytest.approx([0.0, 0.0, 0.0], abs=0.12)
    assert np.all(variance >= 0.0) and np.array_equal(mean, emulator.mean(new))
    at = np.array([0.4, 0.5, 0.6])
    values, slopes = emulator.tangent(at)
    assert values == pytest.approx(truth(at[None])[0], abs=0.05)
    assert slopes[0] == pytest.approx([2.6, -1.0, 0.4], abs=0.05)
    assert slopes[1, 1] == pytest.approx(30.0 * np.exp(-1.5) * 0.6, rel=0.05)


@pytest.mark.parametrize("sd", [0.05, 0.3])
def test_noise_is_found_and_leave_one_out_bands_cover(sd: float) -> None:
    u = sobol(3, 112, 3)
    emulator = fit(u, truth(u)[:, :2] + sd * normals(4, 112, 2))
    assert emulator.run_noise == pytest.approx([sd, sd], rel=0.5)
    assert 0.8 <= emulator.coverage(112) <= 0.98


def test_errors_are_as_large_as_stated() -> None:
    u, new = sobol(3, 100, 5), sobol(3, 64, 6)
    emulator = fit(u, truth(u)[:, :2] + 0.2 * normals(7, 100, 2))
    mean, variance = emulator.predict(new)
    z = (mean - truth(new)[:, :2]) / np.sqrt(variance)
    assert 0.4 < np.sqrt(np.mean(z**2)) < 1.8


def test_leave_one_out_is_what_a_refit_without_the_run_gives() -> None:
    """Closed form of the residual, at the same hyper-parameters: checked where the data fix them."""
    u = sobol(3, 60, 8)
    y = truth(u)[:, :1] + 0.2 * normals(9, 60, 1)
    whole = fit(u, y)
    kept = np.arange(60) != 10
    without = fit(u[kept], y[kept])
    expected = y[10, 0] - without.mean(u[10:11])[0, 0]
    assert whole.left_out[10, 0] == pytest.approx(expected, abs=0.08)

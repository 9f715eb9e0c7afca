"""Sobol indices of the Ishigami function, main effects and slices of what is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from service.domain.study import StudySpec
from tests.worker.optimizer.studies import space
from tests.worker.optimizer.test_posterior import grid_history, response, study
from worker.optimizer.design import FloatArray, sobol
from worker.optimizer.emulator import Emulator, own_emulator
from worker.optimizer.history import Design, History
from worker.optimizer.sensitivity import Effect, effects, slice_along, slice_over, sobol_indices

A, B = 7.0, 0.1


def ishigami(u: FloatArray) -> FloatArray:
    """sin x1 + 7 sin^2 x2 + .1 x3^4 sin x1, x = -pi to pi (Ishigami and Homma 1990)."""
    x = math.pi * (2.0 * u - 1.0)
    wave = np.sin(x[:, 0])
    return np.asarray(wave + A * np.sin(x[:, 1]) ** 2 + B * x[:, 2] ** 4 * wave)


def ishigami_indices() -> tuple[list[float], list[float]]:
    """First-order and total indices in closed form (Saltelli et al. 2008, section 4.3)."""
    first = 0.5 * (1.0 + B * math.pi**4 / 5.0) ** 2
    second = A * A / 8.0
    both = B * B * math.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    total = first + second + both
    return (
        [first / total, second / total, 0.0],
        [(first + both) / total, second / total, both / total],
    )


class Exact:
    """An emulator that knows the function."""

    def mean(self, u: FloatArray) -> FloatArray:
        return ishigami(u)


def test_indices_of_ishigami_lie_within_their_own_error() -> None:
    first, total, first_error, total_error = sobol_indices(Exact(), space(3), 4096, 1)  # type: ignore[arg-type]
    s, t = ishigami_indices()
    assert (s[0], s[1]) == (pytest.approx(0.314, abs=1e-3), pytest.approx(0.442, abs=1e-3))
    # Half-widths at 90 %; three of them leave no doubt.
    assert np.all(np.abs(first - s) < 3.0 * first_error + 1e-3)
    assert np.all(np.abs(total - t) < 3.0 * total_error + 1e-3)
    assert np.all(first_error < 0.05)


def of_study(spec: StudySpec, history: History) -> tuple[Effect, ...]:
    return effects(spec, own_emulator(spec.space, history, "angle_deg"))


def fitted(function: object, count: int, dimension: int) -> Emulator:
    u = sobol(dimension, count, 7, 7)
    values = function(u)  # type: ignore[operator]
    designs = tuple(
        Design(i, tuple(row), i, {"angle_deg": float(v)}, "doe")
        for i, (row, v) in enumerate(zip(u.tolist(), values, strict=True))
    )
    return own_emulator(space(dimension, None), History(designs), "angle_deg")


def test_an_emulator_of_ishigami_gives_its_indices_too() -> None:
    first, total, _, _ = sobol_indices(fitted(ishigami, 256, 3), space(3), 1024, 1)
    s, t = ishigami_indices()
    assert first.tolist() == pytest.approx(s, abs=0.08)
    assert total.tolist() == pytest.approx(t, abs=0.08)


def test_one_variable_decides_and_the_other_is_silent() -> None:
    spec = study(response("angle_deg", 30.0, 1.0))
    found = of_study(spec, grid_history({"angle_deg": lambda a, _b: 20.0 + 20.0 * a}))
    first, second = found
    assert first.variance_share == pytest.approx(1.0, abs=0.05)
    assert first.total_share == pytest.approx(1.0, abs=0.05)
    assert abs(second.variance_share) < 0.02
    assert first.variance_share_error < 0.15
    assert first.rank_correlation > 0.95
    assert first.p_value < 1e-6
    assert abs(second.rank_correlation) < 0.05
    assert first.swing == pytest.approx(20.0 * 10 / 11, abs=0.5)
    assert abs(second.swing) < 0.5
    assert max(first.variance_share_emulator_error, second.variance_share_emulator_error) < 0.05


def test_main_effects_are_the_line_within_their_band() -> None:
    spec = study(response("angle_deg", 30.0, 1.0))
    found = of_study(spec, grid_history({"angle_deg": lambda a, b: 20.0 + 20.0 * a + 6.0 * b}))
    for effect, slope, other in ((found[0], 20.0, 3.0), (found[1], 6.0, 10.0)):
        line = 20.0 + other + slope * np.array(effect.values)
        assert np.all(np.abs(np.array(effect.means) - line) < 2.0 * np.array(effect.sds) + 0.15)
        assert all(0.0 < sd < 1.0 for sd in effect.sds)


def test_few_designs_say_that_their_indices_are_uncertain() -> None:
    """Twelve designs leave the share open, 128 do not, six are too few to say how open."""
    few = fitted(lambda u: 20.0 + 10.0 * np.sin(3.0 * u[:, 0]) + 5.0 * u[:, 1] ** 2, 12, 2)
    many = fitted(lambda u: 20.0 + 10.0 * np.sin(3.0 * u[:, 0]) + 5.0 * u[:, 1] ** 2, 128, 2)
    spec = study(response("angle_deg", 25.0, 1.0))
    errors = [effects(spec, one)[0].variance_share_emulator_error for one in (few, many)]
    assert errors[0] > 2.0 * errors[1]
    none = fitted(lambda u: 20.0 + 10.0 * u[:, 0], 6, 2)
    assert math.isnan(effects(spec, none)[0].variance_share_emulator_error)


def test_slices_pass_through_what_they_cut() -> None:
    box = space(2, None)
    emulator = own_emulator(box, grid_history({"angle_deg": lambda a, b: 20.0 + 20.0 * a * b}), "angle_deg")
    cut = slice_along(emulator, box, (0.3, 0.5), 1)
    assert cut.names == ("rolling_resistance",)
    assert cut.means[0] == pytest.approx(20.0, abs=0.5)
    assert cut.means[-1] == pytest.approx(26.0, abs=0.5)
    assert np.all(cut.sds > 0.0)
    both = slice_over(emulator, box, (0.3, 0.5), (0, 1))
    assert both.means.shape == both.sds.shape == (len(both.axes[0]), len(both.axes[1]))
    # Rows run along the first variable, columns along the second.
    assert both.means[-1, 0] == pytest.approx(20.0, abs=0.5)
    assert both.means[-1, -1] == pytest.approx(40.0, abs=0.5)


def test_a_single_variable_has_all_of_the_variance() -> None:
    designs = tuple(
        Design(i, (u,), i, {"angle_deg": 20.0 + 10.0 * u}, "doe") for i, u in enumerate(np.linspace(0, 1, 8))
    )
    found = of_study(study(response("angle_deg", 25.0, 1.0), dimension=1), History(designs))
    assert found[0].variance_share == 1.0

"""The posterior where it is known: linear responses of Gaussian targets, silent variables, sums."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from service.domain.study import Response, StudySpec
from tests.worker.optimizer.studies import at, space
from worker.optimizer.acquisition import counting_sd
from worker.optimizer.history import Design, History
from worker.optimizer.outlook import build_outlook
from worker.optimizer.posterior import Posterior, Sample, describe, draw, interval, label, posterior, resample
from worker.optimizer.posterior import beliefs as known_of
from worker.optimizer.report import sentences


def response(observable: str, target: float, uncertainty: float, tolerance: float = 0.2) -> Response:
    window = (target - uncertainty, target + uncertainty)
    return Response(observable, target, window, tolerance, uncertainty)


def study(*responses: Response, dimension: int = 2) -> StudySpec:
    return StudySpec("test", 1.0, space(dimension, None), responses)


def grid_history(of: dict[str, Callable[..., float]], dimension: int = 2, levels: int = 6) -> History:
    """Noiseless values of the observables on a full grid of the unit box."""
    axes = np.meshgrid(*[np.linspace(0, 1, levels)] * dimension)
    rows = np.column_stack([a.ravel() for a in axes]).tolist()
    return History(
        tuple(
            Design(i + 1, tuple(x), i, {name: f(*x) for name, f in of.items()}, "doe")
            for i, x in enumerate(rows)
        )
    )


def found(spec: StudySpec, history: History, points: int = 16384) -> Posterior:
    known = posterior(spec, history, points)
    assert known is not None
    return known


def test_a_linear_response_gives_the_gaussian_of_the_textbook() -> None:
    """angle = 20 + 20 u_1, target 30: u_1 ~ N(.5, (sqrt(tau^2 + s^2) / 20)^2), far from the box's ends."""
    spec = study(response("angle_deg", 30.0, 1.0))
    history = grid_history({"angle_deg": lambda a, _b: 20.0 + 20.0 * a})
    first, second = found(spec, history).parameters
    known = known_of(spec, history)
    assert known is not None
    emulator_sd = float(known.emulators["angle_deg"].predict(np.array([[0.5, 0.5]]))[1][0])
    sigma = math.hypot(counting_sd(spec.responses[0]), emulator_sd) / 20.0
    assert first.mean == pytest.approx(0.5, abs=0.005)
    assert first.sd == pytest.approx(sigma, rel=0.05)
    # +- 1.645 sd hold 90 %.
    assert first.upper_90 - first.lower_90 == pytest.approx(2 * 1.645 * sigma, rel=0.05)
    assert (first.label, second.label) == ("identified", "not identified")
    assert second.sd_ratio == pytest.approx(1.0, abs=0.03)
    assert (second.lower_90, second.upper_90) == (
        pytest.approx(0.05, abs=0.02),
        pytest.approx(0.95, abs=0.02),
    )


def test_two_linear_responses_give_the_gaussian_of_both() -> None:
    """y = A u + noise: the posterior covariance is (A^T S^-1 A)^-1, with S the targets' variances."""
    slopes = np.array([[20.0, 20.0], [20.0, -10.0]])
    spec = study(response("angle_deg", 40.0, 1.0), response("literal_angle_deg", 25.0, 1.5))
    history = grid_history(
        {
            "angle_deg": lambda a, b: 20.0 + 20.0 * a + 20.0 * b,
            "literal_angle_deg": lambda a, b: 20.0 + 20.0 * a - 10.0 * b,
        }
    )
    known = known_of(spec, history)
    assert known is not None
    middle = np.array([[0.5, 0.5]])
    variances = [
        counting_sd(r) ** 2 + float(known.emulators[r.observable].predict(middle)[1][0]) ** 2
        for r in spec.responses
    ]
    expected = np.linalg.inv(slopes.T @ np.diag(1.0 / np.array(variances)) @ slopes)
    said = found(spec, history)
    sd = np.sqrt(np.diag(expected))
    assert [p.mean for p in said.parameters] == pytest.approx([0.5, 0.5], abs=0.01)
    assert [p.sd for p in said.parameters] == pytest.approx(sd.tolist(), rel=0.1)
    assert said.correlations[0][1] == pytest.approx(expected[0, 1] / sd[0] / sd[1], abs=0.05)


def test_a_sum_is_identified_only_as_a_combination() -> None:
    spec = study(response("angle_deg", 40.0, 0.5))
    said = found(spec, grid_history({"angle_deg": lambda a, b: 20.0 + 20.0 * (a + b)}))
    assert said.correlations[0][1] < -0.95
    assert {p.label for p in said.parameters} <= {"weak", "not identified"}
    best, rest = said.combinations
    assert best.label == "identified"
    assert list(best.coefficients.values()) == pytest.approx([math.sqrt(0.5)] * 2, abs=0.03)
    assert rest.label == "not identified"
    told = [text for text in sentences(said) if "combination" in text]
    assert len(told) == 1
    assert "0.7" in told[0] and "rolling_resistance" in told[0]


def test_a_combination_of_identified_parameters_is_no_news() -> None:
    spec = study(response("angle_deg", 40.0, 0.5), response("literal_angle_deg", 30.0, 0.5))
    said = found(
        spec,
        grid_history(
            {
                "angle_deg": lambda a, b: 20.0 + 20.0 * (a + b),
                "literal_angle_deg": lambda a, b: 30.0 + 20.0 * (a - b),
            }
        ),
    )
    assert [p.label for p in said.parameters] == ["identified", "identified"]
    assert not [text for text in sentences(said) if "combination" in text]


def test_a_silent_variable_is_not_identified_among_three() -> None:
    spec = study(response("angle_deg", 30.0, 0.5), dimension=3)
    history = grid_history({"angle_deg": lambda a, b, _c: 20.0 + 10.0 * a + 10.0 * b}, 3, 4)
    assert found(spec, history).parameters[2].label == "not identified"


def test_share_within_two_sigma_is_the_strip_that_the_target_leaves() -> None:
    """angle = 20 + 20 u_1, 2 sigma = 2 hypot(tau, s) to both sides: 4 sigma of 20 degrees, less the P(ok) that
    36 sound runs leave open."""
    spec = study(response("angle_deg", 30.0, 0.5))
    said = found(spec, grid_history({"angle_deg": lambda a, _b: 20.0 + 20.0 * a}))
    tau = counting_sd(spec.responses[0])
    assert tau == pytest.approx(math.hypot(0.5, 0.25))
    assert 0.9 * 4 * tau / 20.0 < said.share_within_2_sigma < 4 * math.hypot(tau, 0.4) / 20.0


def test_without_an_uncertainty_the_window_speaks() -> None:
    alone = Response("angle_deg", 30.0, (28.0, 32.0), 0.5)
    assert counting_sd(alone) == pytest.approx(1.0)


def test_where_runs_crash_the_posterior_thins_out() -> None:
    """The response does not depend on the second variable, but every run above .5 of it crashed."""
    spec = study(response("angle_deg", 30.0, 1.0))
    history = grid_history({"angle_deg": lambda a, _b: 20.0 + 20.0 * a})
    crashed = History(
        tuple(
            Design(d.number, d.x, d.seed, None if d.x[1] > 0.5 else d.results, d.origin)
            for d in history.finished
        )
    )
    second = found(spec, crashed).parameters[1]
    assert second.mean < 0.35
    assert second.upper_90 < 0.65


def test_another_unit_makes_no_difference() -> None:
    """The same numbers as kg of a mass and as thousandths of it: intervals of the parameters stay."""
    says = []
    for factor in (1.0, 1e-3):
        spec = study(response("mass_on_base_kg", 30.0 * factor, 1.0 * factor, 0.2 * factor))
        history = grid_history({"mass_on_base_kg": lambda a, _b, f=factor: f * (20.0 + 20.0 * a)})
        says.append(found(spec, history).parameters[0])
    assert says[0].mean == pytest.approx(says[1].mean, abs=1e-3)
    assert says[0].sd == pytest.approx(says[1].sd, rel=1e-2)


def test_moments_of_a_sample_are_those_of_its_weights() -> None:
    spec = study(response("angle_deg", 30.0, 1.0))
    known = known_of(spec, grid_history({"angle_deg": lambda a, _b: 20.0 + 20.0 * a}))
    assert known is not None
    sample = draw(known, 4096)
    even = sample._replace(w=np.full(4096, 1 / 4096))
    said = describe(spec.space, even)
    assert said.effective_points == pytest.approx(4096)
    assert [p.sd_ratio for p in said.parameters] == pytest.approx([1.0, 1.0], abs=0.01)


def test_labels_at_their_limits() -> None:
    assert [label(v) for v in (0.34, 0.35, 0.8, 0.81)] == ["identified", "weak", "weak", "not identified"]


def test_weighted_interval_of_a_uniform_sample() -> None:
    values = np.linspace(0.0, 1.0, 1001)
    lower, upper = interval(values, np.full(1001, 1 / 1001), 0.9)
    assert (lower, upper) == (pytest.approx(0.05, abs=0.002), pytest.approx(0.95, abs=0.002))


@pytest.mark.parametrize("values", [[], [30.0, 31.0], [30.0, 30.0, 30.0]])
def test_nothing_is_known_before_three_different_values(values: list[float]) -> None:
    designs = tuple(Design(i, (0.1 * i, 0.5), i, {"angle_deg": v}, "doe") for i, v in enumerate(values))
    assert posterior(study(response("angle_deg", 30.0, 1.0)), History(designs), 256) is None


def test_responses_have_the_optimizers_own_surrogate_with_its_links() -> None:
    """Coarse runs on a grid and two of the study's own: too few alone, enough with the link."""
    spec = study(response("angle_deg", 30.0, 1.0))
    coarse = grid_history({"angle_deg": lambda a, b: 22.0 + 20.0 * a + 3.0 * b}).finished
    own = tuple(
        Design(100 + i, x, i, {"angle_deg": 20.0 + 20.0 * x[0] + 3.0 * x[1], "mass_on_base_kg": 5.0}, "doe")
        for i, x in enumerate([(0.4, 0.4), (0.8, 0.2)])
    )
    assert posterior(spec, History(own), 256) is None
    history = History(own, coarse=coarse)
    known, outlook = known_of(spec, history), build_outlook(spec, history)
    assert known is not None and outlook.is_linked
    u = np.random.default_rng(1).random((50, 2))
    mean, sd = known.emulators["angle_deg"].predict(u)
    told = outlook.believe([tuple(row) for row in u.tolist()])
    assert mean == pytest.approx(told.mean)
    assert sd == pytest.approx(told.wide)
    assert np.max(np.abs(mean - (20.0 + 20.0 * u[:, 0] + 3.0 * u[:, 1]))) < 0.5
    assert set(known.emulators) == {"angle_deg"}, "a mass that never differs says nothing"
    assert known.crashes.ok_probability(u) == pytest.approx(told.ok)


def test_leaving_designs_out_keeps_the_link() -> None:
    """sensitivity's jackknife: what is left out is the difference's designs, not the other test's."""
    spec = study(response("angle_deg", 30.0, 1.0))
    coarse = grid_history({"angle_deg": lambda a, b: 22.0 + 20.0 * a * b}).finished
    own = grid_history({"angle_deg": lambda a, b: 20.0 + 20.0 * a * b}, levels=2).finished
    known = known_of(spec, History(own, coarse=coarse))
    assert known is not None
    left = known.emulators["angle_deg"].without([0, 3])
    assert left.designs == 2
    assert left.mean(np.array([[0.6, 0.6]]))[0] == pytest.approx(27.2, abs=0.3)


def test_an_observable_that_some_designs_lack_is_fitted_to_the_others() -> None:
    spec = study(response("angle_deg", 30.0, 1.0))
    whole = grid_history({"angle_deg": lambda a, _b: 20.0 + 20.0 * a, "share_on_base": lambda a, b: a * b})
    some = tuple(
        Design(d.number, d.x, d.seed, {**at(d.results["angle_deg"])} if d.number % 2 else d.results, d.origin)
        for d in whole.finished
    )
    known = known_of(spec, History(some))
    assert known is not None
    share = known.emulators["share_on_base"]
    assert share.designs == 18
    assert share.mean(np.array([[0.5, 0.5]]))[0] == pytest.approx(0.25, abs=0.02)


def test_systematic_resampling_takes_each_row_by_its_weight() -> None:
    """Row i comes floor or ceil of count w_i times; a weight of nothing is never drawn."""
    w = np.array([0.5, 0.0, 0.26, 0.24])
    none = np.zeros(4)
    rows = resample(Sample(np.zeros((4, 1)), w, none, none, {}, {}), 50)
    assert np.bincount(rows, minlength=4).tolist() == [25, 0, 13, 12]

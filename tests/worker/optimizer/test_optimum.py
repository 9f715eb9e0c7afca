"""The tie-break for the optimum, rule by rule, and ensembles that spread over what is left open."""

from __future__ import annotations

import math

import numpy as np
import pytest

from service.domain.study import Response, StudySpec
from tests.worker.optimizer.studies import PP, ROLL
from tests.worker.optimizer.test_posterior import grid_history, study
from worker.optimizer.optimum import Optimum, Preferences, ensemble, optimum, window_chance
from worker.optimizer.posterior import Beliefs, Sample, beliefs, draw

# The window is wide and the angle moves with the first variable only: all of .4 < u_1 < .6 is as good.
SPEC = study(Response("angle_deg", 30.0, (25.0, 35.0), 0.5))


@pytest.fixture(scope="module")
def fitted() -> tuple[Beliefs, Sample]:
    return known(SPEC)


def known(spec: StudySpec) -> tuple[Beliefs, Sample]:
    found = beliefs(spec, grid_history({"angle_deg": lambda a, _b: 20.0 + 20.0 * a}))
    assert found is not None
    return found, draw(found, 16384)


def test_the_chance_of_the_window_is_the_gaussians() -> None:
    """Target 30 +- .5 with an emulator that is sure to about .1 degree: one in the middle, half at the edge."""
    found, _ = known(study(Response("angle_deg", 30.0, (29.5, 30.5), 0.5)))
    chance = window_chance(found, np.array([[0.5, 0.5], [0.525, 0.5], [0.7, 0.5]]))
    assert chance[0] > 0.9
    assert chance[1] == pytest.approx(0.5 * chance[0], abs=0.1)
    assert chance[2] < 1e-3


def test_of_equal_chances_the_longest_time_step_wins(fitted: tuple[Beliefs, Sample]) -> None:
    best = optimum(*fitted, like=Preferences(time_step=lambda x: 1e-5 * (1.0 + x[1])))
    assert best.x[1] > 0.7, "as far up as the chance to run allows"
    assert best.tied > 100
    assert best.time_step_s == pytest.approx(1e-5 * (1.0 + best.x[1]))


def test_of_equal_steps_the_nearest_to_literature_wins(fitted: tuple[Beliefs, Sample]) -> None:
    like = Preferences(lambda _x: 1e-5, {PP: 0.52, ROLL: 0.3})
    best = optimum(*fitted, like=like)
    assert best.distance_to_literature is not None
    assert best.distance_to_literature < 0.03
    assert best.x == (pytest.approx(0.52, abs=0.05), pytest.approx(0.3, abs=0.05))


def test_the_chance_goes_before_time_step_and_literature() -> None:
    found, sample = known(study(Response("angle_deg", 30.0, (29.9, 30.1), 0.5)))
    like = Preferences(lambda x: x[0], {PP: 0.9})
    assert optimum(found, sample, like=like).x[0] == pytest.approx(0.5, abs=0.02)


def test_a_design_that_was_run_can_win(fitted: tuple[Beliefs, Sample]) -> None:
    run = (0.5, 0.423456)
    best = optimum(*fitted, tried=[run], like=Preferences(None, {PP: run[0], ROLL: run[1]}))
    assert best.x == run
    assert best.distance_to_literature == 0.0


def test_an_ensemble_spreads_over_what_is_not_identified(fitted: tuple[Beliefs, Sample]) -> None:
    found, sample = fitted
    best = optimum(found, sample, like=Preferences(None, {PP: 0.5, ROLL: 0.5}))
    sets = ensemble(found, sample, best, 5, 0.9)
    assert sets.members[0].x == best.x
    assert len({m.x for m in sets.members}) == 5
    assert min(m.window_probability for m in sets.members) >= sets.level == 0.9
    assert sum(m.weight for m in sets.members) == pytest.approx(1.0)
    silent = sorted(m.x[1] for m in sets.members)
    assert (silent[0], silent[-1]) == (pytest.approx(0.0, abs=0.1), pytest.approx(1.0, abs=0.1))
    # 25 to 35 degrees are .25 to .75 of the first variable.
    assert all(0.25 < m.x[0] < 0.75 for m in sets.members)


def test_an_ensemble_comes_back_from_its_seed(fitted: tuple[Beliefs, Sample]) -> None:
    found, sample = fitted
    best = Optimum((0.5, 0.5), 1.0, None, None, 1)
    again = ensemble(found, sample, best, 4)
    assert ensemble(found, sample, best, 4) == again
    assert ensemble(found, sample, best, 8).members[3].x == again.members[3].x, (
        "the first n are the ensemble of n"
    )
    other = study(Response("angle_deg", 30.0, (25.0, 35.0), 0.5))
    reseeded = StudySpec(other.material, other.scale, other.space, other.responses, seed=2)
    assert ensemble(*known(reseeded), best, 4).members != again.members
    assert ensemble(found, sample, best, 1).members[0].weight == 1.0


def test_a_level_that_nothing_reaches_is_lowered_and_said() -> None:
    found, sample = known(study(Response("angle_deg", 30.0, (29.99, 30.01), 0.5)))
    best = optimum(found, sample)
    sets = ensemble(found, sample, best, 3, 0.99)
    assert len(sets.members) == 3
    assert sets.level < 0.99
    assert "too few" in sets.text
    assert all(math.isfinite(m.window_probability) for m in sets.members)

"""One conformance suite for every strategy, and the synthetic rig against its formula."""

from __future__ import annotations

import numpy as np
import pytest

from worker.optimizer.bench import play, seen_by
from worker.optimizer.stopping import Stop
from worker.optimizer.strategies import Strategy, available
from worker.optimizer.synthetic import SyntheticRig, crash_probability, study, true_angle

STRATEGIES = list(available().values())


@pytest.fixture(params=STRATEGIES, ids=lambda s: s.name)
def strategy(request: pytest.FixtureRequest) -> Strategy:
    found: Strategy = request.param
    return found


@pytest.mark.parametrize("parallel", [1, 3])
def test_a_strategy_keeps_the_contract(strategy: Strategy, parallel: int) -> None:
    spec = study("coke", 5, budget=10, parallel=parallel)
    designs, stop = play(strategy, spec, SyntheticRig())
    assert isinstance(stop, Stop)
    assert 6 <= len(designs) <= 10
    assert [d.number for d in designs] == list(range(1, len(designs) + 1))
    assert len({(d.x, d.seed) for d in designs}) == len(designs)
    for d in designs:
        assert d.x == tuple(v.snap(a) for v, a in zip(spec.space.variables, d.x, strict=True))
    assert strategy.recommend(spec, seen_by(designs, 11, spec)) in {d.x for d in designs}


def test_a_strategy_is_a_pure_function(strategy: Strategy) -> None:
    spec = study("sinter", 6, budget=9)
    designs, _ = play(strategy, spec, SyntheticRig())
    for number in (1, 7, 8):
        history = seen_by(designs[: number - 1], number, spec)
        first, again = (strategy.propose(spec, history, number) for _ in range(2))
        assert first == again
        assert not isinstance(first, Stop)
        assert first.x == designs[number - 1].x


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
    sample = [rig.run(x, seed) or 0.0 for seed in range(400)]
    assert np.std(sample) == pytest.approx(0.5, abs=0.06)

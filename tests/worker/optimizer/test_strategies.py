"""One conformance suite for every strategy, the service's and the rivals of the bench."""

from __future__ import annotations

import dataclasses
from functools import cache

import pytest

from service.domain.strategy import STRATEGIES
from service.domain.study import StudySpec, TableRow
from tests.worker.optimizer.studies import at
from worker.optimizer.bench import play, seen_by
from worker.optimizer.history import Design, History, Pending
from worker.optimizer.plain_designs import REASONS
from worker.optimizer.proposed import Proposal
from worker.optimizer.rivals import rivals
from worker.optimizer.stopping import Stop, recommend
from worker.optimizer.strategies import BY_NAME, Strategy
from worker.optimizer.synthetic import SyntheticRig, study

ALL = [*BY_NAME.values(), *rivals().values()]
ROWS = tuple(
    TableRow(dict(zip(study("coke", 1).space.names, x, strict=True)))
    for x in ((0.5, 0.5, 0.3, 0.3), (0.7, 0.2, 0.5, 0.4), (0.333, 0.5, 0.3, 0.3), (0.5, 0.5, 0.3, 0.3))
)
# A full factorial of four variables takes 16; the surrogate's strategies show with 9 what they do.
BUDGET = {name: 16 if name in REASONS else 9 for name in [*STRATEGIES, *rivals()]}


@pytest.fixture(params=ALL, ids=lambda s: s.name)
def strategy(request: pytest.FixtureRequest) -> Strategy:
    found: Strategy = request.param
    return found


def spec_for(strategy: Strategy, budget: int | None = None, parallel: int = 1) -> StudySpec:
    """A study that names the strategy; a rival needs no name."""
    name = strategy.name if strategy.name in STRATEGIES else "auto"
    table = ROWS if name == "table" else ()
    return study("coke", 5, budget or BUDGET[strategy.name], parallel, strategy=name, table=table)


@cache
def played(strategy: Strategy, parallel: int = 1) -> tuple[tuple[Design, ...], Stop]:
    """The study of `spec_for`, played once for all tests."""
    return play(strategy, spec_for(strategy, parallel=parallel), SyntheticRig())


def test_every_strategy_that_a_study_may_name_is_there() -> None:
    assert set(BY_NAME) == set(STRATEGIES)


@pytest.mark.parametrize("parallel", [1, 3])
def test_a_strategy_keeps_the_contract(strategy: Strategy, parallel: int) -> None:
    spec = spec_for(strategy, parallel=parallel)
    designs, stop = played(strategy, parallel)
    assert isinstance(stop, Stop)
    assert stop.text.endswith(".")
    assert 4 <= len(designs) <= spec.budget
    assert [d.number for d in designs] == list(range(1, len(designs) + 1))
    assert len({(d.x, d.seed) for d in designs}) == len(designs)
    assert {d.origin for d in designs} <= {"doe", "model", "replicate"}
    for d in designs:
        assert all(v.lower <= a <= v.upper for v, a in zip(spec.space.variables, d.x, strict=True))
        if spec.strategy != "table":
            assert d.x == tuple(v.snap(a) for v, a in zip(spec.space.variables, d.x, strict=True))
    assert strategy.recommend(spec, seen_by(designs, spec.budget + 1, spec)) in {d.x for d in designs}


def test_a_strategy_is_a_pure_function(strategy: Strategy) -> None:
    spec = spec_for(strategy)
    designs, _ = played(strategy)
    for number in (1, 4, min(9, len(designs))):
        history = seen_by(designs[: number - 1], number, spec)
        first, again = (strategy.propose(spec, history, number) for _ in range(2))
        assert first == again
        assert not isinstance(first, Stop)
        assert first.x == designs[number - 1].x


def test_a_strategy_never_runs_over_its_budget(strategy: Strategy) -> None:
    spec = spec_for(strategy)
    numbers = range(1, spec.budget + 1)
    spent = tuple(Design(n, (0.3 + 0.01 * n, 0.5, 0.3, 0.3), n, at(20.0 + n), "manual") for n in numbers)
    assert isinstance(strategy.propose(spec, History(spent), spec.budget + 1), Stop)


def test_coarse_runs_and_known_rows_cost_no_budget(strategy: Strategy) -> None:
    spec = spec_for(strategy)
    known = tuple(
        Design(n, (0.3 + 0.01 * n, 0.5, 0.3, 0.3), n, at(20.0), "import") for n in range(1, spec.budget + 1)
    )
    if strategy.name in STRATEGIES:
        assert isinstance(strategy.propose(spec, History(known), spec.budget + 1), Proposal)


def test_most_designs_failing_pauses_whatever_the_strategy() -> None:
    broken = tuple(
        Design(n, (0.3, 0.5, 0.3, 0.3), n, at(None if n < 4 else 30.0), "doe") for n in range(1, 6)
    )
    for strategy in BY_NAME.values():
        spec = spec_for(strategy)
        stop = strategy.propose(spec, History(broken), 6)
        assert isinstance(stop, Stop)
        assert (stop.reason, stop.numbers) == ("too_many_failures", {"failed": 3.0, "finished": 5.0})
        seen = History(broken, accepted=5)
        assert isinstance(strategy.propose(spec, seen, 6), Proposal), "a person has seen these and went on"


@pytest.mark.parametrize("name", [n for n in STRATEGIES if n != "auto"])
def test_a_fixed_design_ends_with_its_counts_and_the_emulators_best(name: str) -> None:
    spec = spec_for(BY_NAME[name])
    designs, stop = played(BY_NAME[name])
    assert stop.reason == "design_complete"
    counts = [stop.numbers[verdict] for verdict in ("feasible", "unfeasible", "error")]
    assert sum(counts) == len(designs)
    inside = [d for d in designs if d.angle_deg is not None and spec.primary.contains(d.angle_deg)]
    assert counts[0] == len(inside)
    best = recommend(spec, History(designs))
    assert best is not None
    assert not best.certified, "nothing has its seeds"
    assert stop.numbers["expected_miss_deg"] == best.primary.expected_miss


def test_pending_designs_are_not_asked_for_twice(strategy: Strategy) -> None:
    spec = spec_for(strategy, parallel=3)
    first = strategy.propose(spec, History(), 1)
    assert isinstance(first, Proposal)
    waiting = History(pending=(Pending(1, first.x, first.seed, first.origin),))
    second = strategy.propose(spec, waiting, 2)
    assert isinstance(second, Proposal)
    assert second.x != first.x


def test_a_larger_budget_goes_on_where_the_smaller_ended() -> None:
    for name in ("sobol", "factorial", "latin_hypercube"):
        spec = spec_for(BY_NAME[name], 16)
        designs, _ = play(BY_NAME[name], spec, SyntheticRig())
        longer = dataclasses.replace(spec, budget=40)
        answer = BY_NAME[name].propose(longer, History(designs), len(designs) + 1)
        assert isinstance(answer, Proposal)
        assert answer.x not in {d.x for d in designs}

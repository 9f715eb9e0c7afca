"""Designs of experiments against what defines them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.stats import qmc

from service.domain.strategy import least_budget
from service.domain.study import TableRow
from tests.worker.optimizer.studies import at, space, spec_of
from worker.optimizer.design import to_unit
from worker.optimizer.history import Design, History
from worker.optimizer.plain_designs import next_planned, orthogonal_array, plan
from worker.optimizer.proposed import Proposal
from worker.optimizer.stopping import Stop


@pytest.mark.parametrize("factors", range(1, 10))
@pytest.mark.parametrize("budget", [16, 20, 27, 36, 64])
def test_an_array_is_orthogonal(factors: int, budget: int) -> None:
    """Strength 2: in any two columns every pair of levels comes equally often."""
    array = orthogonal_array(factors, budget)
    assert array.shape[1] == factors
    assert len(array) <= budget
    for a, b in itertools.combinations(array.T, 2):
        pairs, counts = np.unique(np.column_stack([a, b]), axis=0, return_counts=True)
        assert len(pairs) == len(np.unique(a)) * len(np.unique(b))
        assert len(set(counts)) == 1


@pytest.mark.parametrize("factors", range(1, 10))
def test_the_least_budget_of_an_array_has_an_array(factors: int) -> None:
    assert len(orthogonal_array(factors, least_budget("taguchi", factors))) == least_budget(
        "taguchi", factors
    )


def test_the_array_of_four_variables_and_nine_runs_is_l9() -> None:
    u = to_unit(space(3), plan(spec_of(space(3), strategy="taguchi", budget=9)))
    assert len(u) == 9
    assert {tuple(sorted(set(column))) for column in u.T.tolist()} == {(0.0, 0.5, 1.0)}


def test_a_factorial_uses_the_budget_for_levels() -> None:
    designs = plan(spec_of(space(3), strategy="factorial", budget=20))
    levels = [len({x[j] for x in designs}) for j in range(3)]
    assert sorted(levels) == [2, 3, 3]
    assert len(set(designs)) == len(designs) == 18


def test_a_factorial_has_no_more_levels_than_the_grid() -> None:
    designs = plan(spec_of(space(2, 0.5), strategy="factorial", budget=100))
    assert len(set(designs)) == len(designs) == 9


def test_a_latin_hypercube_has_one_design_in_each_slice_and_is_more_even_than_chance() -> None:
    u = to_unit(space(2, None), plan(spec_of(space(2, None), strategy="latin_hypercube", budget=20)))
    for column in u.T:
        assert sorted(np.floor(column * 20).astype(int)) == list(range(20))
    chance = [qmc.discrepancy(qmc.LatinHypercube(2, rng=seed).random(20)) for seed in range(20)]
    assert qmc.discrepancy(u) < min(chance)


def test_a_table_runs_in_its_order_and_rows_with_results_never() -> None:
    box = space(1)
    name = box.names[0]
    rows = (TableRow({name: 0.2}), TableRow({name: 0.4}, {"angle_deg": 28.0}), TableRow({name: 0.35}))
    spec = spec_of(box, strategy="table", table=rows)
    known = (Design(1, (0.4,), 0, at(28.0), "import"),)
    asked = []
    done = list(known)
    while isinstance(answer := next_planned(spec, History(tuple(done)), len(done) + 1), Proposal):
        asked.append(answer.x)
        done.append(Design(len(done) + 1, answer.x, answer.seed, at(30.0), answer.origin))
    assert asked == [(0.2,), (0.35,)]
    assert isinstance(answer, Stop)
    assert answer.numbers["unfeasible"] + answer.numbers["feasible"] == 2.0, "of the simulations"

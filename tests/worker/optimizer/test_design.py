"""Initial designs, candidates and seeds: on the grid, distinct, and functions of their key alone."""

from __future__ import annotations

import numpy as np
import pytest

from service.domain.search_space import SearchSpace, Variable, default_space
from tests.worker.optimizer.studies import PP, ROLL, space
from worker.optimizer.design import (
    around,
    candidates,
    grid_size,
    initial_design,
    simulation_seed,
    whole_grid,
)

SPACES = [space(1), space(2, None), space(3, 0.25), default_space(), space(1, 0.5)]


@pytest.mark.parametrize("box", SPACES)
@pytest.mark.parametrize("seed", range(5))
def test_designs_are_distinct_and_allowed(box: SearchSpace, seed: int) -> None:
    for found in (
        initial_design(box, seed, 7),
        candidates(box, seed, 9),
        around(box, candidates(box, seed, 9)[0], seed, 9),
    ):
        assert len(set(found)) == len(found) > 0
        for x in found:
            assert x == tuple(v.snap(value) for v, value in zip(box.variables, x, strict=True))


def test_initial_design_does_not_depend_on_how_many_are_asked_for() -> None:
    assert initial_design(default_space(), 3, 100)[:6] == initial_design(default_space(), 3, 6)
    assert initial_design(default_space(), 3, 6) != initial_design(default_space(), 4, 6)


def test_initial_design_spreads_better_than_chance() -> None:
    """Sobol: of the first 8 points each half of each variable holds 4; random designs miss that by sd 1.4."""
    for seed in range(5):
        u = np.array(initial_design(space(3, None), seed, 8))
        assert np.all(np.sum(u < 0.5, axis=0) == 4)


def test_a_small_grid_is_listed_whole() -> None:
    box = SearchSpace((Variable(PP, 0.1, 0.35, 0.1), Variable(ROLL, 0.0, 1.0, 1.0)))
    assert grid_size(box) == 6
    assert set(whole_grid(box)) == {(p, r) for p in (0.1, 0.2, 0.3) for r in (0.0, 1.0)}
    assert set(candidates(box, 1, 1)) == set(whole_grid(box))
    assert sorted(initial_design(box, 1, 100)) == sorted(whole_grid(box))


def test_seeds_differ_and_avoid_the_used_ones() -> None:
    seeds = [simulation_seed(1, n, ()) for n in range(1, 200)]
    assert len(set(seeds)) == len(seeds)
    assert simulation_seed(1, 5, ()) == seeds[4]
    assert simulation_seed(1, 5, {seeds[4]}) != seeds[4]

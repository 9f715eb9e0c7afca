"""Which thread computes which slab, and along which axis slabs lie."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from demcore.neighbours import best_slabs
from demcore.shares import share_out, share_slabs
from tests.demcore.builders import bed

WEIGHTS = st.lists(st.integers(0, 50), min_size=1, max_size=7)


def loads(weight, workers):
    """What each worker has, with the turns that all of them take together."""
    shares = share_out(np.array(weight, dtype=float), workers)
    mine = [shares.turn[a:b] for a, b in itertools.pairwise(shares.start)]
    return [sum(weight[k] for k in turns) for turns in mine], sorted(np.concatenate(mine).tolist())


@given(WEIGHTS, st.integers(1, 3))
def test_every_turn_is_taken_once_and_nobody_has_much_more_than_must_be(weight, workers):
    # Graham 1969: heaviest first ends within 4/3 - 1/(3 m) of the best schedule on m machines.
    found, taken = loads(weight, workers)
    assert taken == list(range(len(weight)))
    choices = itertools.product(range(workers), repeat=len(weight))
    best = min(
        max(sum(w for w, c in zip(weight, choice, strict=True) if c == k) for k in range(workers))
        for choice in choices
    )
    assert max(found) <= (4.0 / 3.0 - 1.0 / (3.0 * workers)) * best + 1e-9


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_all_slabs_of_a_bed_are_shared_out(workers):
    s = bed(300)
    s.advance(1)
    count = len(s.neighbours.slab_start) - 1
    assert count > 3
    even, odd = share_slabs(s.neighbours, s.near_walls, s.dormant.state, workers)
    # Even slabs 2 k, and turns k of finish_slabs: the odd slab 2 k - 1 and the move of 2 k - 1 and 2 k.
    assert sorted(even.turn) == list(range((count + 1) // 2))
    assert sorted(odd.turn) == list(range(count // 2 + 1))
    assert even.start[-1] == len(even.turn)
    assert len(even.start) == workers + 1


def test_slabs_lie_across_a_bed_and_not_up_to_the_few_above_it():
    stream = np.random.default_rng(1)
    flat = stream.uniform([0.0, 0.0, 0.0], [2.0, 1.0, 0.2], (2000, 3))
    jet = stream.uniform([0.9, 0.4, 0.2], [1.1, 0.6, 6.0], (60, 3))
    axis, bounds = best_slabs(np.concatenate([flat, jet]), 0.1)
    assert axis == 0
    assert len(bounds) > 10


@given(st.integers(0, 2**32 - 1), st.floats(0.02, 0.5))
def test_slabs_are_as_thick_as_asked_for(seed, width):
    position = np.random.default_rng(seed).normal(size=(400, 3)) * [1.0, 0.5, 2.0]
    axis, bounds = best_slabs(position, width)
    edges = np.append(bounds[1:], position[:, axis].max())
    lowest = position[:, axis].min()
    assert bounds[0] == -np.inf
    assert (np.diff(np.concatenate([[lowest], edges])) >= width * (1.0 - 1e-12)).all() or len(bounds) == 1

"""Groups, what costs budget, and the training hash."""

from __future__ import annotations

import math

import pytest

from tests.worker.optimizer.studies import at
from worker.optimizer.history import Design, History, Pending

A, B = (0.1, 0.2), (0.3, 0.4)
DESIGNS = (
    Design(1, A, 11, at(30.0), "doe"),
    Design(2, B, 12, at(None), "doe"),
    Design(3, A, 13, at(31.0), "replicate"),
    Design(4, B, 14, at(25.0), "manual"),
)


def test_groups_join_the_seeds_of_one_x() -> None:
    first, second = History(DESIGNS).groups()
    assert (first.x, first.numbers, first.angles_deg, first.failures) == (A, (1, 3), (30.0, 31.0), 0)
    assert (second.numbers, second.angles_deg, second.failures) == ((2, 4), (25.0,), 1)


def test_free_designs_are_those_that_were_known_and_the_coarse_ones() -> None:
    coarse = (Design(5, A, 1, at(30.0), "coarse", 2.0),)
    known = (*DESIGNS, Design(6, B, 9, at(25.0), "import"))
    assert History(known, coarse=coarse, coarse_pending=(Pending(7, B, 2, "coarse", 2.0),)).free == 3


def test_training_hash_ignores_order_and_sees_every_result() -> None:
    known = History(DESIGNS).training_hash
    assert History(tuple(reversed(DESIGNS))).training_hash == known
    changed = (*DESIGNS[:3], Design(4, B, 14, at(25.001), "manual"))
    assert History(changed).training_hash != known
    assert History(DESIGNS, (Pending(5, A, 15, "model"),)).training_hash != known


def test_an_angle_is_finite_or_missing() -> None:
    with pytest.raises(ValueError, match="finite"):
        Design(1, A, 1, at(math.nan), "doe")

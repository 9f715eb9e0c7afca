"""The core against closed forms: each case names its source; `python -m demcore verify` prints the same table."""

from __future__ import annotations

import pytest

from demcore.verification import CASES, Outcome


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_the_core_meets_the_closed_form(case):
    outcomes = list(case())
    assert outcomes
    failed = [
        f"{o.name}: expected {o.expected:.6g}, got {o.got:.6g} ({o.source})" for o in outcomes if not o.passed
    ]
    assert not failed, "\n".join(failed)


def test_an_outcome_outside_its_tolerance_fails():
    assert not Outcome("x", "source", 1.0, 1.02, 0.01).passed
    assert not Outcome("x", "source", 1.0, float("nan"), 0.01).passed

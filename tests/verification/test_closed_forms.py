"""The core against closed forms: each case names its source; `python -m demcore verify` prints the same table."""

from __future__ import annotations

import math

import pytest

from demcore.errors import BlowUp
from demcore.verification.cases import CASES, SLOW_CASES
from demcore.verification.outcome import Outcome, run_cases, share_of


def failures(case):
    outcomes = list(case())
    assert outcomes
    return "\n".join(
        f"{o.name}: expected {o.expected:.6g}, got {o.got:.6g} ({o.source})" for o in outcomes if not o.passed
    )


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_the_core_meets_the_closed_form(case):
    assert failures(case) == ""


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("case", SLOW_CASES, ids=lambda case: case.__name__)
def test_the_core_meets_the_slow_case(case):
    assert failures(case) == ""


def test_an_outcome_outside_its_tolerance_fails():
    assert Outcome("x", "source", 1.0, 1.01, 0.011).passed
    assert not Outcome("x", "source", 1.0, 1.02, 0.01).passed
    assert not Outcome("x", "source", 1.0, math.nan, 0.01).passed
    assert share_of("x", "source", -200.0, -201.0, 0.01).passed
    assert not share_of("x", "source", -200.0, -203.0, 0.01).passed


def test_a_record_holds_the_published_keys_and_is_json():
    record = Outcome("x", "source", 1.0, math.nan, 0.01).record()
    assert record == {
        "name": "x",
        "source": "source",
        "expected": 1.0,
        "got": None,
        "tolerance": 0.01,
        "passed": False,
    }


def test_a_case_that_breaks_down_is_a_failure_and_the_others_still_run():
    def breaks():
        yield Outcome("before", "source", 1.0, 1.0, 0.0)
        raise BlowUp("particle 3 is no longer finite")

    def holds():
        yield Outcome("after", "source", 2.0, 2.0, 0.0)

    outcomes = list(run_cases((breaks, holds)))
    assert [o.passed for o in outcomes] == [True, False, True]
    assert outcomes[1].name == "breaks: blow_up: particle 3 is no longer finite"

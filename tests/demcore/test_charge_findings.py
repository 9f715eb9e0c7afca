"""The paper's findings beside a summary: what is told where one side has no heap."""

from __future__ import annotations

from demcore.experiments.charge_findings import compare_findings


def a_summary(**more):
    """One heap, on the far side."""
    findings = {
        "piles": 1,
        "near_height_m": None,
        "far_height_m": 2.0,
        "near_size_m": None,
        "far_size_m": 0.19,
        "depressions": [],
    }
    inputs = {"charge": {"name": "coke"}}
    return {"findings": findings, "inputs": inputs, "belt": {"stratification": 0.8}, **more}


def segregation(summary):
    return next(finding for finding in compare_findings(summary) if finding.name == "Segregation")


def test_without_a_heap_the_sides_grains_are_told_and_nothing_is_claimed():
    found = segregation(a_summary(near_side_size_m=0.138, far_side_size_m=0.211))
    assert found.here == "only one side has a pile; grains on the far side 211 mm, on the near one 138 mm"
    assert found.agrees is None


def test_a_summary_from_before_these_were_told_is_read():
    assert segregation(a_summary()).here == "only one side has a pile"
    empty = segregation(a_summary(near_side_size_m=float("nan"), far_side_size_m=0.2))
    assert empty.here == "only one side has a pile"

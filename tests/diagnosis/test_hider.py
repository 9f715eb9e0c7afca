"""The hider keeps its word: SNR as asked, null without a cause, designs shared, nothing of the analyser in it."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest

from service.domain.data_set.suitability import suitability
from tests.diagnosis.hider import (
    Cause,
    Plan,
    _inside,
    _theta,
    cases,
    draw,
    draw_design,
    effect_free,
    signature,
)
from tests.diagnosis.truth import EFFECTS, SCATTER, correlation, observe

HERE = Path(__file__).parent
ALLOWED = ("service.domain.data_set", "tests.diagnosis")
HIDES = (
    "truth.py",
    "hider.py",
    "scorer.py",
    "tier.py",
    "piles/bank.py",
    "piles/heap_reading.py",
    "piles/liggghts_pile.py",
)


def a_plan(seed: int) -> Plan:
    stream = np.random.default_rng(seed)
    design = draw_design(stream)
    return Plan(design, {c.material: _theta(stream, False) for c in design.conditions})


@pytest.mark.parametrize("name", HIDES)
def test_hider_and_scorer_share_only_the_data_format(name: str) -> None:
    tree = ast.parse((HERE / name).read_text())
    modules = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    modules += [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
    ours = [m for m in modules if m.split(".")[0] in ("worker", "service", "demcore", "tests")]
    assert all(m.startswith(ALLOWED) for m in ours), ours


def test_an_effect_has_the_snr_that_was_asked_for() -> None:
    stream, found = np.random.default_rng(5), None
    while found is None:
        plan = a_plan(int(stream.integers(1000)))
        found = _inside(plan, "single", 8.0, stream)
    assert np.linalg.norm(signature(plan, found[0])) == pytest.approx(8.0, rel=1e-3)


def test_what_calibration_absorbs_is_no_signal() -> None:
    """A cause along the truth's own slopes leaves nothing; so does no cause."""
    plan = a_plan(7)
    assert np.linalg.norm(signature(plan, [Cause({})])) == 0.0
    strong, weak = (
        np.linalg.norm(signature(plan, [Cause({}, mass_factor=1.0, observable="repose_angle_deg", shift=s)]))
        for s in (1.0, 0.5)
    )
    # Linear, and shorter than the 12 sd that a degree on nine piles of .3 deg would be without re-calibration.
    assert strong == pytest.approx(2.0 * weak, rel=1e-6)
    assert 0.0 < strong < 3.0 / 0.3 * np.sqrt(2.0)


@pytest.mark.parametrize("effect", sorted(EFFECTS))
def test_every_effect_of_the_truth_changes_something(effect: str) -> None:
    plan = a_plan(11)
    reach, _ = EFFECTS[effect]
    found = [(c, plan.theta[c.material]) for c in plan.design.conditions]
    assert any(observe(c, theta, {effect: reach}) != observe(c, theta, {}) for c, theta in found)


def test_scatter_has_valid_correlations() -> None:
    assert np.min(np.linalg.eigvalsh(correlation(list(SCATTER)))) > 0.0


def test_cases_are_as_many_kinds_as_asked_and_repeat_for_a_seed() -> None:
    stream = np.random.default_rng(3)
    design = draw_design(stream)
    one = draw(1, "single", 5.0, design, np.random.default_rng(9))
    two = draw(1, "single", 5.0, design, np.random.default_rng(9))
    assert one.data == two.data and one.hidden == two.hidden and len(one.hidden) == 1
    null = draw(1, "null", 0.0, design, np.random.default_rng(9))
    assert null.hidden == {} and suitability(null.data).usable == null.data
    outside = draw(1, "outside", 8.0, design, np.random.default_rng(9))
    assert outside.places and not outside.hidden
    left = draw(1, "left_out", 8.0, design, np.random.default_rng(9))
    assert left.unknown in EFFECTS and not left.hidden


def test_eight_cases_in_a_row_are_of_one_design() -> None:
    drawn = [case for case, _ in zip(cases(40, 12), range(9), strict=False)]
    missing = [{(o.condition, o.replicate, o.observable) for o in case.data.observations} for case in drawn]
    assert all(m == missing[0] for m in missing[:8]) and missing[8] != missing[0]


def test_effect_free_sets_are_clean() -> None:
    data = next(effect_free(1, 4))
    assert all(len(names) == 10 for names in data.replicates.values())

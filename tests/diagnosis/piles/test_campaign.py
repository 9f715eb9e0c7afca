"""The scoring of answers to simulated piles, on answers written by hand."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.diagnosis.piles import campaign
from tests.diagnosis.piles.bank import scored_sets
from tests.diagnosis.piles.campaign import case_of, main, run, told

SETS = scored_sets()
ANSWERS = Path(__file__).parent / "answers"


def answer(verdict: str, claims: tuple[str, ...] = (), **more: Any) -> dict[str, Any]:
    """The published form, with what the scorer reads."""
    return {
        "verdict": verdict,
        "claims": [{"effect": effect, "inclusion": 0.99} for effect in claims],
        "also_possible": [],
        "unexplained": [],
        "remainder": None,
        "gain": None,
        "cost": {"runs": 10, "simulated": 4},
        "seconds": 360.0,
        **more,
    }


def first(cause: str) -> str:
    return next(name for name, hidden in SETS.items() if hidden == cause)


def keep(folder: Path, name: str, content: dict[str, Any]) -> None:
    (folder / f"{name}.json").write_text(json.dumps(content), encoding="utf-8")


def test_right_wrong_silent_and_outside_are_told_apart(tmp_path: Path) -> None:
    """Worth by the design: 1 right, -3 a claim on nothing, .4 unexplained outside, 0 silent."""
    keep(tmp_path, first("cohesion"), answer("named", ("cohesion",)))
    keep(tmp_path, first("null"), answer("named", ("lift_speed",)))
    keep(tmp_path, first("rim"), answer("unexplained", unexplained=[{"block": "summary:pile.toe"}]))
    keep(tmp_path, first("base_rough"), answer("no_misfit"))
    found = told(tmp_path)
    rows = {row["hidden"]: row for row in found["by_cause"]}
    assert rows["cohesion"]["named_right"] == 1 and rows["cohesion"]["utility"] == 1.0
    assert rows["null"]["named_wrong"] == 1 and rows["null"]["utility"] == -3.0
    assert rows["rim"]["placed"] == 1 and rows["rim"]["utility"] == pytest.approx(0.4)
    assert rows["base_rough"]["flagged"] == 0 and rows["base_rough"]["utility"] == 0.0
    assert found["utility"] == pytest.approx((1.0 - 3.0 + 0.4 + 0.0) / 4.0)
    assert (found["sets"], found["runs_asked"], found["runs_made"], found["hours"]) == (4, 40, 16, 0.4)


def test_what_is_outside_the_library_is_no_hidden_effect_of_it() -> None:
    assert case_of(first("rim")).hidden == {} and case_of(first("rim")).kind == "outside"
    assert set(case_of(first("wide_psd")).hidden) == {"wide_psd"}


def test_a_run_goes_on_where_it_was_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names, asked = list(SETS)[:3], []
    for name in names:
        (tmp_path / f"{name}.npz").touch()

    def ask(name: str) -> dict[str, Any]:
        asked.append(name)
        return answer("no_misfit")

    monkeypatch.setattr(campaign, "ask", ask)
    monkeypatch.setattr(campaign, "BANK", tmp_path)
    keep(tmp_path, names[1], answer("named"))
    run(tmp_path, [*names, list(SETS)[3]])  # of which there is no run
    assert asked == [names[0], names[2]]
    assert json.loads((tmp_path / f"{names[1]}.json").read_text(encoding="utf-8"))["verdict"] == "named"


def test_the_score_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    keep(tmp_path, first("null"), answer("no_misfit"))
    assert main(["score", str(tmp_path)]) == 0
    assert "1 data sets, utility 0.000" in capsys.readouterr().out


def test_the_score_in_the_documents_is_that_of_the_answers_that_are_kept() -> None:
    """At least forty sets; whoever changes an answer or the scorer finds out what the page says."""
    found = told(ANSWERS)
    page = (ANSWERS.parents[3] / "docs" / "diagnosis_piles.md").read_text(encoding="utf-8")
    assert found["sets"] >= 40
    assert f"**{found['sets']} data sets, utility {found['utility']:.3f}**" in page
    assert sum(row["named_wrong"] for row in found["by_cause"]) == 0
    models = {json.loads(path.read_text())["model_version"] for path in ANSWERS.glob("*.json")}
    assert len(models) == 1

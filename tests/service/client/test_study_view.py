"""What the demo shows, folded from a study's events."""

from __future__ import annotations

import re
from typing import Any

import pytest
from rich.console import Console

from service.client.paper import PAPER
from service.client.rest import Event
from service.client.study_view import StudyView
from service.client.tables import LiveTable, closing_table, plain_line, status, studies_table
from service.domain.search_space import PAPER_PARAMETERS

STUDY = {
    "budget": 10,
    "spec": {"responses": [{"target": 25.5}], "variables": {"rolling_resistance": {}}},
}


def design(
    kind: str, number: int, state: str, angle: float | None = None, verdict: str | None = None
) -> Event:
    data: dict[str, Any] = {"number": number, "state": state, "x": {"rolling_resistance": 0.1 * number}}
    return Event(kind, {**data, "angle_deg": angle, "verdict": verdict, "failure_class": None}, "1")


@pytest.fixture
def view() -> StudyView:
    return StudyView.of(STUDY, now=100.0)


def test_nothing_is_claimed_before_the_first_result(view: StudyView) -> None:
    view.fold(design("design_proposed", 1, "WAITING"))
    assert view.best is None
    assert view.seconds_left(160.0) is None


def test_best_is_nearest_to_the_target_and_time_left_goes_by_the_pace(view: StudyView) -> None:
    for number, angle in ((1, 20.0), (2, 26.0), (3, 31.0), (4, None)):
        view.fold(design("design_finished", number, "COMPLETE" if angle else "FAILED", angle, "unfeasible"))
    assert view.best is not None
    assert view.best.number == 2
    assert view.finished == 4
    assert view.seconds_left(140.0) == pytest.approx(10.0 * 6)


def test_progress_shows_while_it_runs_and_goes_with_the_result(view: StudyView) -> None:
    view.fold(design("design_started", 1, "RUNNING"))
    view.fold(Event("progress", {"number": 1, "attempt": 1, "fraction": 0.42, "phase": "discharge"}))
    assert status(view.designs[1]) == "discharge 42 %"
    view.fold(design("design_returned", 1, "WAITING"))
    assert status(view.designs[1]) == "waiting"
    view.fold(design("design_finished", 1, "COMPLETE", 25.2, "feasible"))
    view.fold(Event("progress", {"number": 1, "attempt": 1, "fraction": 0.99, "phase": "late"}))
    assert status(view.designs[1]) == "feasible"


def test_progress_of_an_unknown_design_is_ignored(view: StudyView) -> None:
    assert view.fold(Event("progress", {"number": 9, "fraction": 0.1})) is None
    assert view.designs == {}


def test_a_stop_that_was_taken_back_is_forgotten(view: StudyView) -> None:
    view.fold(Event("study_stopping", {"state": "finishing", "stop_reason": "certified", "stop_text": "so"}))
    view.fold(Event("study_goes_on", {"state": "running"}))
    assert (view.state, view.stop_reason, view.stop_text) == ("running", None, None)


def test_the_end_is_told(view: StudyView) -> None:
    data = {"study_id": 1, "state": "completed", "stop_reason": "certified", "stop_text": "within 0.5"}
    view.fold(Event("study_finished", data, "9"))
    assert (view.state, view.stop_reason, view.stop_text) == ("completed", "certified", "within 0.5")
    assert view.seconds_left(200.0) == 0.0


def drawn(thing: object) -> str:
    console = Console(width=120, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(thing)
    return console.export_text()


def test_the_live_table_has_the_design_its_angle_and_the_foot(view: StudyView) -> None:
    view.fold(design("design_finished", 1, "COMPLETE", 25.21, "feasible"))
    text = drawn(LiveTable(view, "pellet"))
    assert "0.10" in text
    assert "25.21" in text
    assert "feasible" in text
    assert "1 of at most 10 done" in text
    assert "best so far 25.21" in text


def test_a_plain_line_says_the_same(view: StudyView) -> None:
    line = view.fold(design("design_finished", 1, "COMPLETE", 25.21, "feasible"))
    assert line is not None
    assert plain_line(view, line, 110.0) == (
        "design   1  rolling 0.10  angle  25.21  feasible  best 25.21 (design 1)  at most 1:30 left"
    )


def test_the_papers_tables_hang_together() -> None:
    """Table 6's totals are stated in the text too: 26, 55 and 16; Table 5 has all four parameters."""
    assert {name: result.total for name, result in PAPER.items()} == {"coke": 26, "sinter": 55, "pellet": 16}
    for result in PAPER.values():
        assert set(result.optimum) == set(PAPER_PARAMETERS)


def test_the_closing_table_stands_beside_tables_5_to_7() -> None:
    outcome = {
        "optimum": {"rolling_resistance": 0.31},
        "simulations": {"feasible": 3, "unfeasible": 8, "error": 2},
        "repeats_deg": [25.4, 25.9],
    }
    lines = [line.split("│") for line in drawn(closing_table("pellet", outcome)).splitlines() if "│" in line]
    rows = {cells[1].strip(): [cell.strip() for cell in cells[2:4]] for cells in lines}
    assert rows["rolling (Table 5)"] == ["0.31", "0.20"]
    assert rows["simulations (Table 6)"] == ["13", "16"]
    assert rows["error"] == ["2", "1"]
    assert rows["repose angle, repeat 2 (Table 7)"] == ["25.9°", "25.0°"]
    assert rows["repose angle, repeat 3 (Table 7)"] == ["-", "24.4°"]


def test_a_coarse_run_is_no_best_and_costs_no_time_of_the_budget(view: StudyView) -> None:
    coarse = {"number": 1, "x": {}, "state": "COMPLETE", "origin": "coarse", "angle_deg": view.target_deg}
    view.fold(Event("design_finished", coarse))
    assert view.best is None
    assert (view.finished, view.seconds_left(200.0)) == (0, None)
    for number in range(2, view.budget + 4):
        own = {**coarse, "number": number, "origin": "doe", "angle_deg": view.target_deg + 2.0}
        view.fold(Event("design_finished", own))
    assert view.best is not None
    assert view.best.number == 2
    assert view.seconds_left(200.0) == 0.0


def test_the_list_of_studies_says_what_came_out_beside_the_window() -> None:
    spec = {"scale": 3.0, "budget": 6, "responses": [{"observable": "angle_deg", "window": [25.0, 26.0]}]}
    common = {"material": "pellet", "spec": spec, "created_at": "2026-11-29T19:22:00Z"}
    found = {"responses": {"angle_deg": {"mean": 26.04, "half_width_90": 2.2, "unit": "deg"}}}
    ended = {
        "id": 1,
        "state": "completed",
        "counters": {"feasible": 1, "unfeasible": 4, "error": 1},
        "recommendation": found,
        "stop": {"reason": "budget"},
    }
    begun = {
        "id": 2,
        "state": "running",
        "counters": {"feasible": 0, "unfeasible": 0, "error": 0},
        "recommendation": None,
        "stop": None,
    }
    text = drawn(studies_table([common | ended, common | begun]))
    assert [re.split(r" {2,}", line.strip()) for line in text.splitlines()[1:]] == [
        ["1", "pellet ×3", "completed", "6/6, 1 failed", "26.04 ± 2.2°", "25–26", "budget", "11-29 19:22"],
        ["2", "pellet ×3", "running", "0/6", "-", "25–26", "11-29 19:22"],
    ]

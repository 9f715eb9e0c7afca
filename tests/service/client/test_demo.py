"""What the demo asks for and what it writes down."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any

import pytest
from rich.console import Console

from service.client.demo import DemoOptions, follow, summarise, tell
from service.client.rest import Client, Event

STUDY: dict[str, Any] = {
    "id": 4,
    "state": "completed",
    "spec": {
        "material": "pellet",
        "scale": 2.0,
        "responses": [{"target": 25.5, "window": [25.0, 26.0]}],
    },
    "counters": {"feasible": 5, "unfeasible": 9, "error": 1},
    "recommendation": {
        "x": {"rolling_resistance": 0.3},
        "mean_deg": 25.44,
        "replicates_deg": [25.3, 25.5, 25.6],
        "certified": True,
        "responses": {"angle_deg": {"unit": "deg", "mean": 25.44, "half_width_90": 0.27}},
    },
    "noise": [{"observable": "angle_deg", "unit": "deg", "tolerance": 0.5, "text": "0.3 deg measured"}],
    "stop": {"reason": "certified", "text": "Within 0.5 deg (90 %).", "numbers": {}},
}


def test_only_what_was_asked_for_is_sent() -> None:
    assert DemoOptions().body() == {"material": "pellet"}
    assert DemoOptions("coke", scale=3.0, budget=20).body() == {
        "material": "coke",
        "scale": 3.0,
        "budget": 20,
    }
    assert DemoOptions(seed=0).body() == {"material": "pellet", "seed": 0}


def test_demo_json_has_exactly_the_promised_fields() -> None:
    assert summarise(STUDY, 7.126) == {
        "material": "pellet",
        "scale": 2.0,
        "target_deg": 25.5,
        "window_deg": [25.0, 26.0],
        "optimum": {"rolling_resistance": 0.3},
        "angle_deg": 25.44,
        "repeats_deg": [25.3, 25.5, 25.6],
        "certified": True,
        "stop_reason": "certified",
        "simulations": {"feasible": 5, "unfeasible": 9, "error": 1},
        "minutes": 7.13,
    }


def test_a_study_without_an_angle_claims_nothing() -> None:
    study = {**STUDY, "recommendation": None, "stop": {"reason": "too_many_failures", "text": None}}
    outcome = summarise(study, 1.0)
    assert (outcome["optimum"], outcome["angle_deg"], outcome["certified"]) == ({}, None, False)
    assert "there is no optimum" in told(outcome, study)


def test_a_demo_that_spent_its_budget_says_how_to_go_on() -> None:
    study = {**STUDY, "stop": {"reason": "budget", "text": "All are spent."}}
    assert '"warm_start": [4]' in told(summarise(study, 1.0), study)
    assert "To go on" not in told(summarise(STUDY, 1.0), STUDY)


@pytest.mark.parametrize(
    ("certified", "words"),
    [
        (True, "angle_deg 25.44 deg, certified: within ±0.27 deg (90 %)."),
        (False, "angle_deg 25.44 deg, not certified: within ±0.27 deg (90 %)."),
    ],
)
def test_the_end_says_whether_it_is_certified(certified: bool, words: str) -> None:
    study = {**STUDY, "recommendation": {**STUDY["recommendation"], "certified": certified}}
    text = told(summarise(study, 7.0), study)
    assert words in text
    assert "angle_deg scatters between runs: 0.3 deg measured; tolerance 0.5 deg." in text
    assert "Ended after 7.0 minutes: Within 0.5 deg (90 %)." in text


def test_a_study_without_an_angle_among_its_responses_tells_what_it_has() -> None:
    mass = {"mass_on_base_kg": {"unit": "kg", "mean": 12.345, "half_width_90": 0.5}}
    found = {"x": {"rolling_resistance": 0.3}, "certified": True, "responses": mass}
    study = {**STUDY, "recommendation": found, "noise": None}
    assert "mass_on_base_kg 12.35 kg, certified: within ±0.5 kg (90 %)." in told(summarise(study, 1.0), study)


class Played(Client):
    """A service whose study is paused for `reason`, and goes on where it can."""

    def __init__(self, reason: str) -> None:
        super().__init__("http://nowhere.invalid")
        self.reason = reason
        self.told: list[str] = []

    def study(self, study_id: int) -> dict[str, Any]:
        return {"state": "paused", "pause": {"reason": self.reason, "text": "why"}}

    def events(self, study_id: int) -> Iterator[Event]:
        for kind, state in (("study_paused", "paused"), ("study_resumed", "running"), ("end", "completed")):
            self.told.append(kind)
            yield Event(kind, {"state": state}, "1")


@pytest.mark.parametrize(
    ("reason", "heard"),
    [("user", ["study_paused", "study_resumed", "end"]), ("too_many_failures", ["study_paused"])],
)
@pytest.mark.parametrize("is_terminal", [False, True])
def test_a_users_pause_is_waited_for_and_no_other(reason: str, heard: list[str], is_terminal: bool) -> None:
    """Who paused it is there to resume it; nobody looks at the failures of a demo."""
    study = {**STUDY, "budget": 4, "spec": {**STUDY["spec"], "seed": 1, "variables": {}}}
    console = Console(file=io.StringIO(), force_terminal=is_terminal, width=100)
    with Played(reason) as client:
        follow(client, study, console)
    assert client.told == heard


def told(outcome: dict[str, Any], study: dict[str, Any]) -> str:
    out = io.StringIO()
    tell(outcome, study, Console(file=out, width=100))
    return out.getvalue()

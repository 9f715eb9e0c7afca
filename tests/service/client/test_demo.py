"""What the demo asks for and what it writes down."""

from __future__ import annotations

import io
from typing import Any

import pytest
from rich.console import Console

from service.client.demo import DemoOptions, summarise, tell

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


def told(outcome: dict[str, Any], study: dict[str, Any]) -> str:
    out = io.StringIO()
    tell(outcome, study, Console(file=out, width=100))
    return out.getvalue()

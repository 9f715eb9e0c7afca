"""`talus plan`: what it refuses before anything starts, and how it tells an answer."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from service.cli import main
from service.client.diagnose import tell_plan
from tests.builders.diagnoses import CONDITIONS, OBSERVATIONS, tables


def test_bad_conditions_are_one_line_and_status_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / CONDITIONS).write_text(tables()[CONDITIONS].replace("pellet,45", "pellet,-45"))
    assert main(["plan", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "mass_kg" in error and "-45" in error


def test_a_diagnosis_still_needs_observations(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / CONDITIONS).write_text(tables()[CONDITIONS])
    assert main(["diagnose", str(tmp_path)]) == 2
    assert OBSERVATIONS in capsys.readouterr().err


def test_an_answer_is_a_line_a_cause_and_what_adds_most() -> None:
    effect = {"effect": "cohesion", "unit": "1", "detectable_from": 0.123, "nameable_from": None}
    text = io.StringIO()
    tell_plan(
        {
            "effects": [{**effect, "verdict": "detectable", "alike": ["shape_roll"]}],
            "sentences": ["No cause could be named."],
            "adds": [
                {"condition": "wet", "nameable": ["cohesion"]},
                {"condition": "dry", "nameable": []},
            ],
        },
        Console(file=text, width=120),
    )
    told = text.getvalue()
    assert "cohesion  detectable  Bond number 0.12 at 4 % moisture  -           shape_roll" in told
    assert "No cause could be named." in told
    assert "wet adds: cohesion." in told and "dry adds: no further cause." in told

"""The card opens as a picture and its sentence says what the result says, never more."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.worker.diagnosis.plants import QUICK, diagnosed
from worker.diagnosis.card import HEIGHT, WIDTH, colour_of, draw_card, misfits, sentence
from worker.diagnosis.diagnose import Diagnosis
from worker.diagnosis.gain import held_out_gain, with_gain
from worker.diagnosis.result import Possible, Result, Where
from worker.diagnosis.stand_in import StandIn


def test_a_named_effect_is_drawn_and_its_map_is_paler(tmp_path: Path) -> None:
    data, found = diagnosed("belt_speed", -0.08)
    result = with_gain(found.result, held_out_gain(data, StandIn(), found, QUICK))
    draw_card(found, result, tmp_path / "card.png")
    with Image.open(tmp_path / "card.png") as picture:
        assert picture.size == (WIDTH, HEIGHT) and picture.format == "PNG"
        colours = picture.convert("RGB").getcolors(WIDTH * HEIGHT) or []
        assert len(colours) > 50
    before, after = misfits(found)
    assert np.sum(after**2) < 0.7 * np.sum(before**2)


@pytest.mark.parametrize("amplitude", [0.0])
def test_nothing_named_is_drawn_too(tmp_path: Path, amplitude: float) -> None:
    _, found = diagnosed("belt_speed", amplitude)
    draw_card(found, found.result, tmp_path / "card.png")
    assert (tmp_path / "card.png").stat().st_size > 5000


def test_a_refusal_is_a_card_with_its_sentence(tmp_path: Path) -> None:
    refused = Result("refused", "m", "", None, sentences=("Refused: too thin.",))
    draw_card(Diagnosis(refused), refused, tmp_path / "card.png")
    assert sentence(refused, None) == "Refused: too thin."


def test_the_sentence_is_consistent_with_and_never_proves() -> None:
    _, found = diagnosed("belt_speed", -0.08)
    said = sentence(found.result, QUICK.known)
    assert "consistent with" in said and "prove" not in said
    assert "the belt runs at another speed" in said and "tachometer" in said


def test_every_verdict_has_a_sentence() -> None:
    _, found = diagnosed("belt_speed", 0.0)
    quiet = dataclasses.replace(found.result, verdict="no_misfit")
    assert "calibrated model" in sentence(quiet, QUICK.known)
    unsure = dataclasses.replace(quiet, verdict="ambiguous", also_possible=(Possible("density", 0.5),))
    assert "any of: density" in sentence(unsure, QUICK.known)
    strange = dataclasses.replace(quiet, verdict="unexplained", unexplained=(Where("condition:P1", 0.9),))
    assert "condition:P1" in sentence(strange, QUICK.known)


def test_colours() -> None:
    assert colour_of(0.0) == "#ffffff" and colour_of(9.0) == "#b2182b" and colour_of(-9.0) == "#2166ac"
    assert colour_of(float("nan")) != "#ffffff"

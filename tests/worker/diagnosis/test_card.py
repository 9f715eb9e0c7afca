"""The card opens as a picture and its sentence says what the result says, never more."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from service.domain.misfit_words import READINGS, place
from tests.worker.diagnosis.plants import QUICK, diagnosed
from worker.diagnosis.card import HEIGHT, SHORT_HEIGHT, WIDTH, colour_of, draw_card, misfits, sentence
from worker.diagnosis.diagnose import Diagnosis
from worker.diagnosis.gain import held_out_gain, with_gain
from worker.diagnosis.result import Possible, Result, Where
from worker.diagnosis.stand_in import StandIn
from worker.diagnosis.summaries import NAMES


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
    with Image.open(tmp_path / "card.png") as picture:
        assert picture.size == (WIDTH, SHORT_HEIGHT)


def test_a_refusal_is_a_card_with_its_sentence(tmp_path: Path) -> None:
    refused = Result("refused", "m", "", None, sentences=("Refused: too thin.",))
    draw_card(Diagnosis(refused), refused, tmp_path / "card.png")
    assert sentence(refused, None) == "Refused: too thin."


def test_the_sentence_is_consistent_with_and_never_proves() -> None:
    _, found = diagnosed("belt_speed", -0.08)
    said = sentence(found.result, QUICK.known)
    assert "consistent with" in said and "prove" not in said
    assert "the belt runs at another speed" in said and "to confirm: tachometer on the belt" in said
    assert "equivalent to belt speed -" in said and "In brackets the 90 % interval." in said


def test_every_verdict_has_a_sentence() -> None:
    _, found = diagnosed("belt_speed", 0.0)
    quiet = dataclasses.replace(found.result, verdict="no_misfit")
    assert "calibrated model" in sentence(quiet, QUICK.known)
    unsure = dataclasses.replace(quiet, verdict="ambiguous", also_possible=(Possible("density", 0.5),))
    likely = sentence(unsure, QUICK.known)
    assert "one cause is the likeliest, but it is not named" in likely and "(density)" in likely
    several = dataclasses.replace(unsure, also_possible=(Possible("density", 0.5), Possible("cohesion", 0.4)))
    assert "any of: density, cohesion" in sentence(several, QUICK.known)
    strange = dataclasses.replace(quiet, verdict="unexplained", unexplained=(Where("condition:P1", 0.9),))
    assert "condition P1" in sentence(strange, QUICK.known)


def test_every_summary_and_every_kind_of_place_has_words() -> None:
    assert set(READINGS) == {name for names in NAMES.values() for name in names}
    assert place("summary:pile.ln_density") == "bulk density of the pile tests"
    assert place("wet:wet") == "the wet conditions" and place("test:charge") == "all charge tests"
    assert place("material:coke") == "all tests of coke" and place("new:kind") == "new:kind"


def test_colours() -> None:
    assert colour_of(0.0) == "#ffffff" and colour_of(9.0) == "#b2182b" and colour_of(-9.0) == "#2166ac"
    assert colour_of(float("nan")) != "#ffffff"

"""Amplitudes in plant words: what the log of a factor, a share, a slope with size or a length becomes."""

from __future__ import annotations

import dataclasses
import math

import pytest

from service.domain.effect_words import estimate_in_words, size_in_words
from service.domain.effects import TOLD_AS, Told, library
from service.domain.errors import InvalidValue


@pytest.mark.parametrize(
    ("effect", "value", "interval", "said"),
    [
        (
            "lift_speed",
            math.log(2.0),
            (math.log(1.6), math.log(2.5)),
            "2.0 (1.6 to 2.5) times the stated lift speed",
        ),
        (
            "lift_speed",
            -math.log(2.0),
            (-math.log(2.5), -math.log(1.6)),
            "0.50 (0.40 to 0.62) times the stated lift speed",
        ),
        ("soft_stiffness", 1.0, (0.5, 1.5), "10 (3 to 32) times the assumed modulus"),
        ("density", 0.07, (0.04, 0.1), "particle density +7 % (+4 to +10 %)"),
        ("weigh_gain", -0.03, (-0.04, -0.02), "every mass -3.0 % (-4.0 to -2.0 %)"),
        (
            "shape_roll",
            0.3,
            (0.2, 0.4),
            "rolling resistance +21 % (+14 to +28 %) of its value at 20 mm with each doubling of the size",
        ),
        ("base_rough", 0.21, (0.16, 0.26), "friction coefficient of the base +0.21 (+0.16 to +0.26)"),
        ("cohesion", 0.3, (0.2, 0.39), "Bond number 0.30 (0.20 to 0.39) at 4 % moisture"),
        ("cohesion", 0.3, (0.0, 0.6), "Bond number 0.3 (0.0 to 0.6) at 4 % moisture"),
        ("feed_offcentre", 0.092, (0.085, 0.099), "92 mm (85 to 99) beside the axis"),
        ("sensor_offset", -0.012, (-0.0162, -0.0078), "every measured height -12 mm (-16 to -8)"),
        ("sensor_tilt", 1.2, (0.9, 1.5), "scanned plane turned by 1.2 degrees (0.9 to 1.5)"),
    ],
)
def test_an_estimate_has_its_interval(
    effect: str, value: float, interval: tuple[float, float], said: str
) -> None:
    assert estimate_in_words(effect, value, interval, library()[effect].unit) == said


@pytest.mark.parametrize(
    ("effect", "size", "said"),
    [
        ("lift_speed", math.log(1.8), "0.56 or 1.8 times the stated lift speed"),
        # Rounded to two digits it would be 1.0 times: no change at all.
        ("lift_speed", 0.04, "0.96 or 1.04 times the stated lift speed"),
        ("soft_stiffness", 0.5, "3.2 times the assumed modulus"),
        ("density", 0.07, "particle density ±7.0 %"),
        (
            "size_friction",
            0.1,
            "sliding friction ±6.9 % of its value at 20 mm with each doubling of the size",
        ),
        ("liner_wear", 0.21, "friction coefficient of the liner ±0.21"),
        ("cohesion", 0.123, "Bond number 0.12 at 4 % moisture"),
        ("feed_offcentre", 0.0461, "46 mm beside the axis"),
        (
            "deflector_tilt",
            2.75,
            "pitch of the near face ±2.8 degrees, of the far face as much the other way",
        ),
    ],
)
def test_a_size_claims_no_sign(effect: str, size: float, said: str) -> None:
    assert size_in_words(effect, size, library()[effect].unit) == said


def test_every_effect_is_told_and_every_kind_is_used() -> None:
    known = library().effects
    assert {effect.told.as_ for effect in known} == set(TOLD_AS)
    for effect in known:
        low = -effect.scale if effect.is_two_sided else 0.0
        estimate = estimate_in_words(effect.id, effect.scale, (low, effect.highest), effect.unit)
        size = size_in_words(effect.id, effect.scale, effect.unit)
        assert "(" in estimate and " to " in estimate and "{" not in estimate
        assert any(c.isdigit() for c in size) and "+" not in size and " -" not in size


def test_an_effect_of_another_library_keeps_its_number() -> None:
    assert size_in_words("magic", 0.0123, "N/m") == "0.0123 N/m"
    assert estimate_in_words("magic", 0.5, (0.25, 0.75), "N/m") == "0.5 (0.25 to 0.75) N/m"


@pytest.mark.parametrize("told", [("factor", "{} times"), ("number", "times"), ("number", "{} of {}")])
def test_words_that_cannot_be_told_are_refused(told: tuple[str, str]) -> None:
    with pytest.raises(InvalidValue):
        dataclasses.replace(library()["density"], told=Told(*told))

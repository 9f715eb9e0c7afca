"""The library holds the effects of the design's table, each with one amplitude, its prior, a check."""

from __future__ import annotations

import dataclasses

import pytest

from service.domain.data_set.records import Condition
from service.domain.effects import Check, library
from service.domain.errors import InvalidValue

# The first column of the table in the design of the diagnosis.
TABLE = [
    "cohesion",
    "shape_roll",
    "size_friction",
    "wide_psd",
    "density",
    "soft_stiffness",
    "vel_restitution",
    "lift_speed",
    "base_rough",
    "liner_wear",
    "feed_offcentre",
    "belt_speed",
    "belt_track",
    "deflector_shift",
    "deflector_tilt",
    "deflector_wear",
    "air_drag",
    "breakage",
    "vibration",
    "sensor_offset",
    "sensor_tilt",
    "weigh_gain",
    "sample_bias",
]
PILE = Condition("p", "pile", "coke", 100.0)
CHARGE = Condition("c", "charge", "coke", 3000.0)


def test_the_ids_are_those_of_the_table() -> None:
    assert sorted(e.id for e in library().effects) == sorted(TABLE)
    assert len(library().self_tests) == 4


def test_every_effect_says_what_it_is() -> None:
    for effect in library().effects:
        assert effect.what and effect.law and effect.amplitude and effect.unit and effect.check.what
        assert effect.lowest <= 0.0 < effect.scale <= effect.highest


def test_base_and_liner_are_one_class() -> None:
    known = library()
    assert known["base_rough"].effect_class == known["liner_wear"].effect_class == "wall_friction"
    assert not known["base_rough"].acts_on(CHARGE) and known["base_rough"].acts_on(PILE)
    assert known["liner_wear"].acts_on(CHARGE) and not known["liner_wear"].acts_on(PILE)


@pytest.mark.parametrize(
    ("effect", "change", "acts"),
    [
        ("cohesion", {}, False),
        ("cohesion", {"moisture_percent": 2.0}, True),
        ("lift_speed", {}, False),
        ("lift_speed", {"removal": "lift"}, True),
        ("vel_restitution", {"drop_height_m": 0.5}, False),
        ("vel_restitution", {"drop_height_m": 0.6}, True),
        ("soft_stiffness", {}, True),
        ("soft_stiffness", {"material": "pellet"}, False),
        ("soft_stiffness", {"material": "lime"}, False),
        ("soft_stiffness", {"cylinder_height_m": 1.0}, False),
        ("soft_stiffness", {"cylinder_height_m": 1.6}, True),
        ("belt_speed", {}, False),
        ("weigh_gain", {}, True),
    ],
)
def test_scopes(effect: str, change: dict[str, object], acts: bool) -> None:
    assert library()[effect].acts_on(dataclasses.replace(PILE, **change)) is acts  # type: ignore[arg-type]


def test_an_effect_with_a_direction_has_two_keys() -> None:
    assert library()["feed_offcentre"].keys == ("feed_offcentre@0", "feed_offcentre@90")
    assert library()["cohesion"].keys == ("cohesion",)


@pytest.mark.parametrize(
    "change",
    [
        {"lowest": 0.1},
        {"scale": 99.0},
        {"scale": 0.0},
        {"check": Check("look", 0.0)},
        {"directions_deg": (0.0,)},
    ],
)
def test_a_wrong_entry_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(InvalidValue):
        dataclasses.replace(library()["cohesion"], **change)  # type: ignore[arg-type]


def test_a_library_without_an_effect_has_another_name() -> None:
    smaller = library().without("density")
    assert "density" not in smaller.name and smaller.name != library().name
    assert len(smaller.effects) == len(library().effects) - 1

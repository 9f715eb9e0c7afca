"""The records refuse what is not allowed; the split's hash holds what it must; thin data are refused in words."""

from __future__ import annotations

import dataclasses

import pytest

from demcore.material import material_names
from demcore.rig import load_rig, rig_names
from service.domain.data_set.reading import data_set_from_tables
from service.domain.data_set.records import Condition, DataSet, Observation, Profile
from service.domain.data_set.rigs import RIGS
from service.domain.data_set.suitability import suitability
from service.domain.errors import InvalidValue
from tests.service.domain.data_set.tables import CONDITIONS, OBSERVATIONS, tables

DATA = data_set_from_tables(tables())


@pytest.mark.parametrize(
    "change", [{"test": "heap"}, {"removal": "pour"}, {"mass_kg": -1.0}, {"drop_height_m": float("nan")}]
)
def test_a_condition_checks_itself(change: dict[str, object]) -> None:
    with pytest.raises(InvalidValue):
        dataclasses.replace(DATA.conditions[0], **change)  # type: ignore[arg-type]


def test_a_data_set_checks_its_references() -> None:
    pile = Condition("a", "pile", "coke", 10.0)
    with pytest.raises(InvalidValue):
        DataSet((pile, pile), ())
    with pytest.raises(InvalidValue):
        DataSet((pile,), (Observation("a", "1", "belt_depth_m", 0.1),))
    with pytest.raises(InvalidValue):
        DataSet((pile,), (), (Profile("b", "1", (0.0,), (0.1,), (0.2,)),))


def test_the_split_hash_sees_values_and_split_but_not_order() -> None:
    turned = DataSet(DATA.conditions[::-1], DATA.observations[::-1])
    assert turned.split_hash == DATA.split_hash
    moved = DataSet(
        (dataclasses.replace(DATA.conditions[0], holdout=True), *DATA.conditions[1:]), DATA.observations
    )
    first = dataclasses.replace(DATA.observations[0], value=36.21)
    changed = DataSet(DATA.conditions, (first, *DATA.observations[1:]))
    assert len({DATA.split_hash, moved.split_hash, changed.split_hash}) == 3


def test_the_hash_of_the_held_out_block_sees_what_was_read_and_no_names() -> None:
    first = DATA.held_out_hash
    assert first is not None
    renamed = [dataclasses.replace(o, replicate=f"run {o.replicate}") for o in DATA.observations[::-1]]
    assert DataSet(DATA.conditions, tuple(renamed)).held_out_hash == first
    trained = dataclasses.replace(DATA.observations[0], value=36.21)
    assert DataSet(DATA.conditions, (trained, *DATA.observations[1:])).held_out_hash == first
    held = dataclasses.replace(DATA.observations[-1], value=0.119)
    assert DataSet(DATA.conditions, (*DATA.observations[:-1], held)).held_out_hash != first
    heavier = dataclasses.replace(DATA.conditions[-1], mass_kg=3100.0)
    assert DataSet((*DATA.conditions[:-1], heavier), DATA.observations).held_out_hash != first
    scan = Profile("c1", "0", (0.0,), (0.1,), (0.2,))
    assert DataSet(DATA.conditions, DATA.observations, (scan,)).held_out_hash != first
    assert DATA.training.held_out_hash is None
    assert DataSet(DATA.conditions, ()).held_out_hash is None


def test_enough_data_are_suitable() -> None:
    judged = suitability(DATA)
    assert judged.usable == DATA and judged.sentences == ()


def test_two_replicates_are_set_aside_and_nothing_left_is_refused() -> None:
    rows = [row for row in OBSERVATIONS.splitlines() if ",2," not in row[:6]]
    judged = suitability(data_set_from_tables(tables(observations="\n".join(rows))))
    assert judged.is_refused
    assert "p1, p2, c1" in judged.sentences[0] and "repeat these" in judged.sentences[0]
    assert judged.sentences[-1].startswith("Refused")


def test_one_condition_under_two_names_is_one() -> None:
    conditions = CONDITIONS.replace("p2,pile,coke,200,4,", "p2,pile,coke,100,,0.02:0.3;0.05:0.7")
    conditions = conditions.replace("0.7,,0", "0.7,0")
    judged = suitability(data_set_from_tables(tables(conditions=conditions)))
    assert judged.is_refused and "one training condition" in judged.sentences[-1]


@pytest.mark.parametrize(
    ("change", "is_another"),
    [
        ({"belt_speed_m_s": 2.0}, False),
        ({"lift_speed_m_s": 0.4}, False),
        ({"base_diameter_m": 1.5}, False),
        ({"cylinder_height_m": 1.6, "cylinder_diameter_m": 1.2}, False),
        ({"base_diameter_m": 1.4}, True),
        ({"removal": "lift"}, True),
        ({"drop_height_m": 0.1}, True),
    ],
)
def test_conditions_differ_in_what_their_test_has(change: dict[str, object], is_another: bool) -> None:
    """Belts are not of a pile, and an empty cell is the rig's size."""
    pile = Condition("a", "pile", "coke", 100.0)
    other = dataclasses.replace(pile, condition="b", **change)  # type: ignore[arg-type]
    assert (other.settings != pile.settings) is is_another
    observed = [
        Observation(name, str(i), "repose_angle_deg", 30.0 + 0.3 * i) for name in "ab" for i in range(3)
    ]
    assert suitability(DataSet((pile, other), tuple(observed))).is_refused is not is_another


def test_the_sizes_of_the_rigs_are_the_simulations() -> None:
    found = {
        name: (rig.base_diameter, rig.cylinder_diameter, rig.cylinder_height)
        for name, rig in ((name, load_rig(name)) for name in rig_names())
    }
    assert {name: tuple(sizes.values()) for name, sizes in RIGS.items()} == found
    assert set(RIGS) == set(material_names())


def test_no_held_out_condition_limits_what_can_be_claimed() -> None:
    judged = suitability(data_set_from_tables(tables(conditions=CONDITIONS.replace(",,1\n", ",,0\n"))))
    assert not judged.is_refused and "not claimed" in judged.sentences[0]

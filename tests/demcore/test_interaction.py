"""Pair tables for any number of materials and surfaces, and the rule for unlike ones."""

from __future__ import annotations

import dataclasses
from dataclasses import replace

import pytest

from demcore.errors import InputError
from demcore.interaction import (
    GrainContact,
    Interaction,
    Interactions,
    Stiffness,
    Surface,
    WallContact,
    compose_table,
    grain_rows,
)
from demcore.material import WallRestitution
from tests.demcore.cases import GRAVEL, OTHER, SAME, SAND, interactions

GRAINS = (GRAVEL, SAND)


def test_rows_are_surfaces_then_each_grain_once_per_restitution_at_walls():
    rows = grain_rows(GRAINS, 2)
    assert [(r.row, r.grain, r.wall.value, r.wall.mass_share) for r in rows] == [
        (2, "gravel", 0.2, 0.25),
        (3, "gravel", 0.5, 0.75),
        (4, "sand", 0.3, 1.0),
    ]


def test_each_pair_of_rows_gets_its_own_numbers():
    table = compose_table(GRAINS, interactions(), ("steel",))
    between = table.interaction
    assert between[1][1] == between[1][2] == between[2][2] == SAME
    assert between[3][3] == OTHER
    assert [between[0][k].restitution for k in (1, 2, 3)] == [0.2, 0.5, 0.3]
    assert [between[k][0].static_friction for k in (1, 2, 3)] == [0.4, 0.4, 0.6]
    assert between[0][3].rolling_resistance == 0.4


def test_unlike_grains_take_the_mean_of_every_coefficient_and_that_is_recorded():
    # physics.md section 1: "for unlike materials take the mean (choice)"
    given = interactions()
    mean = compose_table(GRAINS, given, ()).interaction[1][3]
    assert dataclasses.astuple(mean) == pytest.approx((0.4, 0.6, 0.5, 0.3))
    assert given.assumed_pairs(GRAINS) == ["gravel and sand"]


def test_an_entry_for_unlike_grains_beats_the_rule_in_either_order():
    own = Interaction(0.9, 0.1, 0.1, 0.0)
    given = interactions(grain_contacts=(*interactions().grain_contacts, GrainContact("sand", "gravel", own)))
    table = compose_table(GRAINS, given, ())
    assert table.interaction[1][3] == table.interaction[3][1] == own
    assert given.assumed_pairs(GRAINS) == []


def test_a_wall_contact_may_have_a_restitution_of_its_own():
    contacts = (
        WallContact("gravel", "steel", 0.4, 0.36, 0.2, restitution=0.7),
        interactions().wall_contacts[1],
    )
    table = compose_table(GRAINS, interactions(wall_contacts=contacts), ("steel",))
    assert [table.interaction[0][k].restitution for k in (1, 2, 3)] == [0.7, 0.7, 0.3]


def test_several_surfaces_and_many_materials():
    grains = tuple(
        replace(GRAVEL, name=f"grain {k}", wall_restitution=(WallRestitution(0.1 + 0.1 * k),))
        for k in range(5)
    )
    given = Interactions(
        tuple(
            GrainContact(g.name, g.name, Interaction(0.3, 0.1 * k, 0.1 * k, 0.0))
            for k, g in enumerate(grains)
        ),
        tuple(
            WallContact(g.name, s, 0.2 if s == "rubber" else 0.1, 0.1, 0.0)
            for g in grains
            for s in ("steel", "rubber")
        ),
        (Surface("steel", Stiffness(2e11, 0.3)), Surface("rubber", Stiffness(1e6, 0.49))),
    )
    table = compose_table(grains, given, ("steel", "rubber"))
    assert len(table.stiffness) == 7
    assert table.stiffness[1].youngs_modulus == 1e6
    assert table.interaction[2 + 1][2 + 4].static_friction == pytest.approx(0.25)
    assert table.interaction[1][2].static_friction == 0.2
    assert table.interaction[0][2 + 3].restitution == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"grain_contacts": interactions().grain_contacts[:1]}, "interactions.grain_contacts"),
        ({"wall_contacts": interactions().wall_contacts[:1]}, "interactions.wall_contacts"),
        ({"unlike": "given"}, "interactions.grain_contacts"),
    ],
)
def test_a_pair_that_nothing_says_is_refused(change, field):
    with pytest.raises(InputError) as caught:
        compose_table(GRAINS, interactions(**change), ("steel",))
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"unlike": "geometric"}, "interactions.unlike"),
        (
            {"grain_contacts": (GrainContact("sand", "gravel", SAME), GrainContact("gravel", "sand", SAME))},
            "interactions.grain_contacts",
        ),
        ({"surfaces": (Surface(), Surface())}, "interactions.surfaces"),
    ],
)
def test_an_ambiguous_record_is_refused(change, field):
    with pytest.raises(InputError) as caught:
        interactions(**change)
    assert caught.value.field == field


@pytest.mark.parametrize("numbers", [(1.4, 0.1, 0.1, 0.1), (0.3, 0.1, 0.2, 0.1), (0.3, -0.1, 0.0, 0.1)])
def test_coefficients_outside_their_range_are_refused(numbers):
    with pytest.raises(InputError):
        Interaction(*numbers)
    with pytest.raises(InputError):
        WallContact("gravel", "steel", *numbers[1:], restitution=numbers[0])

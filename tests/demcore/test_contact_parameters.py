"""Contact parameters of a pile test: defaults, further numbers, the paper's averaging, pairs of unlike grains."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import replace

import pytest

from demcore.errors import InputError
from demcore.experiments.contact_parameters import (
    LIMITS,
    ContactParameters,
    PairwiseParameters,
    PartParameters,
    averaged,
    interactions,
    material_table,
)
from demcore.experiments.mix_trials import mix_trials, pairwise_optimum
from demcore.experiments.paper_tables import TABLE_5
from demcore.experiments.pile_case import PileTest
from demcore.interaction import GrainContact, Interaction
from demcore.material import load_material
from demcore.rig import load_rig

PELLET, MIX = load_material("pellet"), load_material("sinter65_pellet35")
SETS = {name: ContactParameters(*values) for name, values in TABLE_5.items()}


def pile(parameters=SETS["pellet"], name="pellet", **changes):
    return PileTest(load_material(name), load_rig(name), parameters, scale=4.0, **changes)


def test_every_parameter_has_its_limits():
    assert tuple(LIMITS) == tuple(f.name for f in dataclasses.fields(ContactParameters))


def test_what_is_not_given_is_the_materials():
    """Row 0 is steel, rows 1 and 2 the pellet with its two restitutions at walls (paper, section 2.1.2)."""
    table = material_table(PELLET, SETS["pellet"])
    assert table.interaction[1][2] == Interaction(0.20, 0.40, 0.9 * 0.40, 0.20)
    assert [table.interaction[0][k] for k in (1, 2)] == [
        Interaction(0.2, 0.40, 0.9 * 0.40, 0.20),
        Interaction(0.5, 0.40, 0.9 * 0.40, 0.20),
    ]


def test_what_is_given_reaches_its_contact_and_no_other():
    usual = material_table(PELLET, SETS["pellet"])
    given = replace(
        SETS["pellet"],
        particle_wall_restitution=0.3,
        particle_wall_rolling_resistance=0.05,
        particle_wall_dynamic_friction=0.1,
    )
    table = material_table(PELLET, given)
    assert table.interaction[1][1] == usual.interaction[1][1]
    assert table.interaction[0][1] == table.interaction[0][2] == Interaction(0.3, 0.40, 0.1, 0.05)
    grains = material_table(PELLET, replace(SETS["pellet"], particle_particle_dynamic_friction=0.2))
    assert grains.interaction[1][1].dynamic_friction == 0.2
    assert grains.interaction[0] == usual.interaction[0]
    both = material_table(PELLET, replace(SETS["pellet"], dynamic_friction_ratio=0.5))
    assert {row.dynamic_friction for row in (both.interaction[0][1], both.interaction[1][1])} == {0.2}


def test_elasticity_and_numerics_reach_the_case():
    given = replace(
        SETS["pellet"],
        youngs_modulus_pa=4e7,
        poisson_ratio=0.3,
        tangential_stiffness_ratio=0.7,
        long_term_damping=0.1,
    )
    case = pile(given).case
    assert {(s.youngs_modulus, s.poisson_ratio) for s in case.table().stiffness} == {(4e7, 0.3)}
    assert case.numerics.stiffness_ratio == 0.7
    assert case.long_term_damping == 0.1
    # dt falls with the square root of the stiffness (physics.md section 1).
    assert case.dt == pytest.approx(pile().dt / 2.0)


def test_another_family_of_laws_is_a_choice():
    case = pile(contact_model="hertz_mindlin").case
    assert case.contact_model == "hertz_mindlin"
    with pytest.raises(InputError, match="long_term_damping"):
        pile(replace(SETS["pellet"], long_term_damping=0.1), contact_model="hertz_mindlin")
    with pytest.raises(InputError, match="contact_model"):
        pile(contact_model="soft")


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"particle_wall_restitution": 0.0}, "particle_wall_restitution"),
        ({"particle_wall_restitution": math.nan}, "particle_wall_restitution"),
        ({"dynamic_friction_ratio": 1.1}, "dynamic_friction_ratio"),
        ({"particle_particle_dynamic_friction": 0.41}, "particle_particle_dynamic_friction"),
        (
            {"dynamic_friction_ratio": 0.9, "particle_wall_dynamic_friction": 0.3},
            "dynamic_friction_ratio",
        ),
        ({"youngs_modulus_pa": 10.0}, "youngs_modulus_pa"),
    ],
)
def test_a_parameter_outside_its_range_is_refused(change, field):
    with pytest.raises(InputError) as caught:
        replace(SETS["pellet"], **change)
    assert caught.value.field == field


def test_the_papers_mix_is_the_plain_mean_of_its_two_materials():
    """Table 5, last column, is the mean of the columns for sinter and pellet."""
    parts = [SETS["sinter"], SETS["pellet"]]
    assert averaged(parts) == SETS["sinter65_pellet35"]
    assert averaged(parts, [0.65, 0.35]).rolling_resistance == pytest.approx(0.65 * 0.24 + 0.35 * 0.20)
    with pytest.raises(InputError, match="mass_shares"):
        averaged(parts, [0.65, 0.65])
    with pytest.raises(InputError, match="dynamic_friction_ratio"):
        averaged([parts[0], replace(parts[1], dynamic_friction_ratio=0.8)])


def test_one_set_for_a_mix_gives_all_its_contacts_the_same_numbers():
    found = interactions(MIX, SETS["sinter65_pellet35"])
    assert len({contact.interaction for contact in found.grain_contacts}) == 1
    assert len(found.grain_contacts) == 3


@pytest.mark.parametrize(
    ("rule", "restitution"), [("mean", 0.3), ("geometric", math.sqrt(0.4 * 0.2)), ("minimum", 0.2)]
)
def test_pairs_keep_their_own_numbers_and_unlike_grains_meet_by_the_rule(rule, restitution):
    found = interactions(MIX, pairwise_optimum(MIX, rule))
    assert found.between("sinter", "sinter").restitution == 0.40
    assert found.between("pellet", "pellet").restitution == 0.20
    unlike = found.between("pellet", "sinter")
    assert unlike.restitution == pytest.approx(restitution)
    assert 0.20 <= unlike.rolling_resistance <= 0.24
    assert unlike.dynamic_friction == pytest.approx(0.9 * unlike.static_friction)
    assert found.at_wall("pellet", "steel").rolling_resistance == 0.20


def test_a_pair_that_is_given_goes_before_the_rule():
    own = Interaction(0.5, 0.6, 0.5, 0.1)
    parameters = replace(pairwise_optimum(MIX, "mean"), pairs=(GrainContact("pellet", "sinter", own),))
    assert interactions(MIX, parameters).between("sinter", "pellet") == own


def test_the_case_of_a_mix_holds_its_parts_at_the_tests_scale():
    case = pile(SETS["sinter65_pellet35"], "sinter65_pellet35").case
    assert [g.name for g in case.grains] == ["sinter", "pellet"]
    assert case.grains[1].sizes.largest == pytest.approx(4.0 * 0.022)
    assert case.fills[0].mix == MIX.mix


@pytest.mark.parametrize(
    ("parameters", "field"),
    [
        (PairwiseParameters((PartParameters("sinter", SETS["sinter"]),)), "parameters.parts"),
        (PairwiseParameters((PartParameters("coke", SETS["coke"]),)), "parameters.parts"),
    ],
)
def test_every_part_needs_its_set_and_nothing_else_has_one(parameters, field):
    with pytest.raises(InputError) as caught:
        pile(parameters, "sinter65_pellet35")
    assert caught.value.field == field


@pytest.mark.parametrize(
    "build",
    [
        lambda: PairwiseParameters((PartParameters("sinter", SETS["sinter"]),) * 2),
        lambda: PairwiseParameters((), "harmonic"),
        lambda: replace(
            pairwise_optimum(MIX, "mean"),
            pairs=(GrainContact("pellet", "pellet", Interaction(0.5, 0.1, 0.1, 0.1)),),
        ),
        lambda: PairwiseParameters(
            (
                PartParameters("sinter", SETS["sinter"]),
                PartParameters("pellet", replace(SETS["pellet"], tangential_stiffness_ratio=0.5)),
            )
        ),
        lambda: pairwise_optimum(PELLET, "mean"),
    ],
)
def test_pairs_that_contradict_themselves_are_refused(build):
    with pytest.raises(InputError):
        build()


def test_the_trials_of_a_mix_differ_in_their_parameters_only():
    trials = mix_trials("sinter65_pellet35", 6.0, (1, 2))
    assert len({t.name for t in trials}) == len(trials) == 2 * (2 + 3 + 2)
    assert {t.test.rig.name for t in trials} == {"sinter65_pellet35"}
    assert next(t.test.parameters for t in trials if t.test.seed == 1) == SETS["sinter65_pellet35"]
    with pytest.raises(InputError, match="a mix"):
        mix_trials("pellet", 4.0, (1,))

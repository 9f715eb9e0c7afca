"""Case: refused whole when anything in it is wrong; the time step of the stiffest, lightest pair."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from demcore.case import Numerics, RestCriterion
from demcore.case_run import contact_model
from demcore.charge import Fill
from demcore.contact.coulomb_spring import CoulombSpring
from demcore.contact.hysteretic_spring import HystereticLinearSpring
from demcore.errors import InputError
from demcore.geometry.walls import Wall
from demcore.identity import identity
from demcore.interaction import GrainContact, Interaction, Stiffness, Surface
from demcore.material import Material, MixPart, SizeClass, SizeDistribution, WallRestitution
from demcore.region import Box, DiscInlet, cylinder
from demcore.time_step import hertz_time_step
from tests.demcore.cases import GRAVEL, SAND, WALLS, a_case, a_feed, a_fill, interactions


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"grains": ()}, "grains"),
        ({"grains": (GRAVEL, GRAVEL)}, "grains"),
        ({"duration": 0.0}, "duration"),
        ({"duration": math.nan}, "duration"),
        ({"duration": 1e-6}, "duration"),
        ({"duration": "3 s"}, "duration"),
        ({"fills": ()}, "fills"),
        ({"contact_model": "linear"}, "contact_model"),
        ({"gravity": (0.0, 0.0)}, "gravity"),
        ({"gravity": (0.0, 0.0, math.inf)}, "gravity"),
        ({"gravity": (0.0, 0.0, 0.0)}, "rest"),
        ({"seed": 1.5}, "seed"),
        ({"seed": -1}, "seed"),
        ({"seed": True}, "seed"),
        ({"time_step": 1.0}, "time_step"),
        ({"time_step": -1e-6}, "time_step"),
        ({"time_step": math.nan}, "time_step"),
        ({"fills": (a_fill(mix=(MixPart("clay"),)),)}, "fill.mix.material"),
        ({"feeds": (a_feed(mix=(MixPart("clay"),)),)}, "feed.mix.material"),
        ({"feeds": (a_feed(inlet=DiscInlet((0.0, 0.0, 1.0), 0.007)),)}, "feed.inlet"),
        ({"feeds": (a_feed(start=3.0, stop=4.0),)}, "feed.start"),
        ({"fills": (a_fill(region=cylinder((0.0, 0.0, 0.0), 0.007, 1.0)),)}, "fill.region"),
        ({"walls": (Wall("plane", material=1),)}, "wall.material"),
        ({"interactions": interactions(wall_contacts=())}, "interactions.wall_contacts"),
        ({"interactions": interactions(unlike="given")}, "interactions.grain_contacts"),
        ({"grains": (GRAVEL, replace(SAND, long_term_damping=0.4))}, "long_term_damping"),
    ],
)
def test_a_wrong_case_is_refused_with_the_field(change, field):
    with pytest.raises(InputError) as caught:
        a_case(**change)
    assert caught.value.field == field
    assert caught.value.allowed


@pytest.mark.parametrize(
    ("build", "field"),
    [
        (lambda: a_fill(mass=None), "fill.mass"),
        (lambda: a_fill(level=0.1), "fill.mass"),
        (lambda: a_fill(mass=-1.0), "fill.mass"),
        (lambda: a_fill(mass=None, level=0.7), "fill.level"),
        (lambda: a_fill(mass=None, level=0.0), "fill.level"),
        (lambda: a_fill(region=Box((0.0, 0.0, 0.0), (1.0, 1.0, math.inf))), "fill.region"),
        (lambda: a_fill(mix=()), "fill.mix"),
        (lambda: a_fill(seed=0.5), "fill.seed"),
        (lambda: Numerics(residual=-0.1), "numerics.residual"),
        (lambda: Numerics(stiffness_ratio=math.nan), "numerics.stiffness_ratio"),
        (lambda: Numerics(skin_share=0.0), "numerics.skin_share"),
        (lambda: Numerics(time_step="quick"), "numerics.time_step"),
        (lambda: RestCriterion(duration=0.0), "rest.duration"),
        (lambda: RestCriterion(speed_share=-0.1), "rest.speed_share"),
        (lambda: replace(GRAVEL, grain_density=1000.0), "grain_density"),
        (lambda: replace(GRAVEL, youngs_modulus=math.nan), "youngs_modulus"),
        (lambda: replace(GRAVEL, name=""), "material.name"),
        (
            lambda: replace(GRAVEL, wall_restitution=(WallRestitution(0.5, 0.5),)),
            "wall_restitution.mass_share",
        ),
        (lambda: WallRestitution(1.4), "wall_restitution.value"),
    ],
)
def test_a_wrong_part_is_refused_with_the_field(build, field):
    with pytest.raises(InputError) as caught:
        build()
    assert caught.value.field == field


def test_without_walls_no_contact_with_steel_needs_saying():
    assert a_case(walls=(), interactions=interactions(wall_contacts=())).touched == frozenset()


def test_unlike_dampings_are_settled_by_the_numerics():
    case = a_case(
        grains=(GRAVEL, replace(SAND, long_term_damping=0.4)), numerics=Numerics(long_term_damping=0.3)
    )
    assert contact_model(case).normal == HystereticLinearSpring(0.001, 0.3, 3.0)


def test_the_defaults_of_the_numerics_are_those_of_the_laws():
    # physics.md section 1: lambda .001, n = 3, r_K = 1, 1e-3 m/s
    assert contact_model(a_case()).normal == HystereticLinearSpring()
    assert contact_model(a_case()).tangential == CoulombSpring()


def brute_force_limit(case):
    """The formula of physics.md section 1 over many pairs of diameters, two grains and the wall."""
    shortest = math.inf
    for a in case.grains:
        for b in case.grains:
            for x in np.linspace(a.sizes.smallest, a.sizes.largest, 60):
                for y in np.linspace(b.sizes.smallest, b.sizes.largest, 60):
                    m, n = (g.particle_density * math.pi / 6 * d**3 for g, d in ((a, x), (b, y)))
                    stiffness = 1 / (1 / (a.youngs_modulus * x) + 1 / (b.youngs_modulus * y))
                    shortest = min(shortest, math.pi / 2 * math.sqrt(m * n / (m + n) / stiffness))
        for surface in case.interactions.surfaces:
            d = a.sizes.smallest
            stiffness = 1 / (1 / (a.youngs_modulus * d) + 1 / (surface.stiffness.youngs_modulus * d))
            mass = a.particle_density * math.pi / 6 * d**3
            shortest = min(shortest, math.pi / 2 * math.sqrt(mass / stiffness))
    return shortest / 15.0


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"grains": (replace(GRAVEL, youngs_modulus=1e9), SAND)},
        {
            "grains": (replace(GRAVEL, sizes=SizeDistribution((SizeClass(0.008, 0.08, 1.0),))), SAND),
            "fills": (a_fill(mix=(MixPart("sand"),)),),
        },
        {"interactions": interactions(surfaces=(Surface("steel", Stiffness(2e11, 0.3)),))},
    ],
)
def test_the_time_step_is_that_of_the_stiffest_lightest_pair(change):
    case = a_case(**change)
    assert case.largest_time_step == pytest.approx(brute_force_limit(case), rel=2e-3)
    assert case.dt == case.largest_time_step


def test_the_papers_preset_also_counts_the_unloading_of_every_pair():
    case = a_case(numerics=Numerics(time_step="paper"))
    # The wall's e = .2 unloads in .2/8 of a loading time that is sqrt(2) times the pair's (its m* is m, not m/2,
    # and K_l is the same); sand's pair has e = .5 and is the lightest: 1/15.
    d, e = 0.008, 0.2
    gravel_wall = math.pi / 2 * math.sqrt(2500.0 * math.pi / 6 * d**3 / (1e6 * d / 2)) * e / 8
    d, e = 0.006, 0.3
    sand_wall = math.pi / 2 * math.sqrt(2600.0 * math.pi / 6 * d**3 / (1e6 * d / 2)) * e / 8
    d, e = 0.008, 0.3
    gravel = math.pi / 2 * math.sqrt(2500.0 * math.pi / 6 * d**3 / 2 / (1e6 * d / 2)) * e / 8
    assert case.dt == pytest.approx(min(gravel_wall, sand_wall, gravel, case_fast()), rel=1e-3)


def case_fast():
    return a_case().dt


def test_hertz_takes_a_fifth_of_the_smallest_rayleigh_time():
    case = a_case(contact_model="hertz_mindlin")
    assert case.dt == pytest.approx(hertz_time_step(0.006, 2600.0, 1e6, 0.25, 0.2))
    with pytest.raises(InputError, match="Rayleigh"):
        replace(case, time_step=case.dt * 1.001)


def test_a_given_time_step_is_taken_up_to_the_limit_which_the_refusal_names():
    limit = a_case().largest_time_step
    assert a_case(time_step=0.5 * limit).dt == 0.5 * limit
    with pytest.raises(InputError, match=f"{limit:.6g} s"):
        a_case(time_step=1.0001 * limit)


def test_the_identity_knows_every_value():
    case = a_case()
    assert identity(case) == identity(a_case())
    others = [
        a_case(seed=5),
        a_case(duration=np.nextafter(3.0, 4.0)),
        a_case(fills=(a_fill(seed=1),)),
        a_case(walls=WALLS[:1]),
        a_case(
            interactions=interactions(
                grain_contacts=(
                    GrainContact("gravel", "gravel", Interaction(0.3, 0.5, 0.45, 0.21)),
                    interactions().grain_contacts[1],
                )
            )
        ),
    ]
    assert len({identity(c) for c in [case, *others]}) == 6


def test_a_case_can_be_made_without_numba():
    code = (
        "import sys\n"
        "import demcore.case, demcore.charge, demcore.region, demcore.interaction, demcore.identity\n"
        "import demcore.experiments.pile_case\n"
        "sys.exit('numba' in sys.modules)\n"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_published_material_works_in_a_case_of_its_own():
    assert isinstance(GRAVEL, Material)
    assert isinstance(a_case().fills[0], Fill)
    assert SAND.particle_density == 2600.0
    assert GRAVEL.particle_density == pytest.approx(2500.0)

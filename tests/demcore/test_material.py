"""Materials: what the paper publishes must hold of the classes that we assume; sampling keeps the shares."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from demcore.errors import InputError
from demcore.material import (
    MaterialPart,
    MixPart,
    SizeClass,
    SizeDistribution,
    coarse_grain,
    cut_off,
    load_material,
    material_names,
    mixed,
    mixed_sizes,
)
from demcore.rig import load_rig, rig_names


def test_the_papers_materials_and_rigs_are_shipped():
    assert material_names() == ("coke", "sinter", "pellet", "sinter65_pellet35")
    assert rig_names() == material_names()
    rig = load_rig("coke")  # Table 2
    assert (rig.base_diameter, rig.cylinder_diameter, rig.cylinder_height) == (1.5, 1.2, 1.6)


@pytest.mark.parametrize(
    ("name", "density", "median", "smallest", "largest"),
    [
        # physics.md section 1 (particle density); paper section 2.1.2 (median, limits; iron sizes doubled)
        ("coke", 847, 0.050, 0.010, 0.100),
        ("sinter", 3105, 0.028, 0.010, 0.080),
        ("pellet", 3480, 0.016, 0.010, 0.022),
    ],
)
def test_published_facts(name, density, median, smallest, largest):
    material = load_material(name)
    assert material.particle_density == pytest.approx(density, abs=0.5)
    assert material.sizes.median_by_mass == pytest.approx(median, rel=0.02)
    assert (material.sizes.smallest, material.sizes.largest) == (smallest, largest)


def test_coke_has_the_mean_particle_mass_of_the_papers_charge():
    # 3 t of coke are 280,000 particles (sections 3.1 and 3.2)
    coke = load_material("coke")
    mass = coke.particle_density * math.pi / 6 * coke.sizes.number_mean_cube
    assert mass == pytest.approx(3000.0 / 280_000, rel=0.02)


def test_sampling_keeps_the_mass_share_of_every_class():
    sizes = load_material("coke").sizes
    d = sizes.sample(20_000, np.random.default_rng(3))
    mass = d**3 / (d**3).sum()
    for c in sizes.classes:
        assert mass[(d >= c.lower) & (d < c.upper)].sum() == pytest.approx(c.mass_share, abs=0.005)


def test_inside_a_class_mass_is_uniform():
    sizes = SizeDistribution((SizeClass(0.010, 0.022, 1.0),))
    d = sizes.sample(50_000, np.random.default_rng(1))
    mass = d**3 / (d**3).sum()
    assert mass[d < 0.013].sum() == pytest.approx(0.25, abs=0.01)
    assert mass[d < 0.016].sum() == pytest.approx(0.50, abs=0.01)
    assert (d**3).mean() == pytest.approx(sizes.number_mean_cube, rel=0.01)


def test_coarse_graining_scales_sizes_only():
    coarse = coarse_grain(load_material("pellet").sizes, 2.0)
    assert (coarse.smallest, coarse.largest) == (0.020, 0.044)
    assert coarse.number_mean_cube == pytest.approx(8.0 * load_material("pellet").sizes.number_mean_cube)


def test_cut_off_joins_the_tails_to_the_classes_inside():
    # the paper: the 1 % of 5 to 10 mm joins 10 to 20 mm
    sizes = SizeDistribution(
        (SizeClass(0.005, 0.01, 0.01), SizeClass(0.01, 0.02, 0.29), SizeClass(0.02, 0.04, 0.7))
    )
    cut = cut_off(sizes, 0.01, 0.03)
    assert [(c.lower, c.upper) for c in cut.classes] == [(0.01, 0.02), (0.02, 0.03)]
    assert [c.mass_share for c in cut.classes] == pytest.approx([0.30, 0.70])


@pytest.mark.parametrize(
    ("build", "field"),
    [
        (lambda: SizeClass(-0.01, 0.02, 1.0), "sizes.lower"),
        (lambda: SizeClass(0.02, 0.01, 1.0), "sizes.upper"),
        (lambda: SizeClass(0.01, 0.02, 0.0), "sizes.mass_share"),
        (lambda: SizeDistribution(()), "sizes"),
        (lambda: SizeDistribution((SizeClass(0.01, 0.02, 0.5),)), "sizes.mass_share"),
        (lambda: load_material("gravel"), "material"),
        (lambda: load_rig("gravel"), "rig"),
        (lambda: coarse_grain(load_material("coke").sizes, math.nan), "scale"),
    ],
)
def test_bad_input_names_the_field_and_what_is_allowed(build, field):
    with pytest.raises(InputError) as caught:
        build()
    assert caught.value.field == field
    assert caught.value.allowed


def iron(share=0.65):
    parts = (
        MaterialPart(load_material("sinter"), share),
        MaterialPart(load_material("pellet"), 1.0 - share),
    )
    return mixed("iron", parts)


def test_the_shipped_mix_is_the_papers_iron():
    mix = load_material("sinter65_pellet35")
    assert mix.mix == (MixPart("sinter", 0.65), MixPart("pellet", 0.35))
    assert mix.grains == (load_material("sinter"), load_material("pellet"))
    # By hand: 1 / (.65 / 1863 + .35 / 2088), the same over phi = .6, and .65 * 31 + .35 * 25.5.
    assert mix.bulk_density == pytest.approx(1936.02, abs=0.01)
    assert mix.particle_density == pytest.approx(1936.02 / 0.6, abs=0.02)
    assert mix.target_deg == pytest.approx(29.075)
    assert mix.window_deg == pytest.approx((27.6, 30.55))
    assert [(w.value, w.mass_share) for w in mix.wall_restitution] == [
        (0.2, pytest.approx(0.5)),
        (0.5, pytest.approx(0.5)),
    ]


def test_a_mix_holds_its_parts_mass_at_every_size():
    """Pellet of 10 to 22 mm, uniform by mass, over sinter's classes: 10/12 of it lies under 20 mm."""
    sizes = iron().sizes
    assert [(c.lower, c.upper) for c in sizes.classes][:3] == [(0.01, 0.02), (0.02, 0.022), (0.022, 0.03)]
    assert sizes.classes[0].mass_share == pytest.approx(0.65 * 0.27 + 0.35 * 10 / 12)
    assert sizes.classes[1].mass_share == pytest.approx(0.65 * 0.28 * 0.2 + 0.35 * 2 / 12)
    assert sum(c.mass_share for c in sizes.classes) == pytest.approx(1.0)
    coarse = iron().coarse_grained(3.0)
    assert coarse.sizes.largest == pytest.approx(0.24)
    assert coarse.grains[1].sizes.largest == pytest.approx(0.066)


def test_a_part_of_one_size_keeps_its_mass_inside_anothers_class():
    one = replace(load_material("pellet"), sizes=SizeDistribution((SizeClass(0.03, 0.03, 1.0),)))
    sizes = mixed_sizes((MaterialPart(load_material("pellet"), 0.5), MaterialPart(one, 0.5)))
    assert [(c.lower, c.upper, c.mass_share) for c in sizes.classes] == [
        (0.01, 0.022, pytest.approx(0.5)),
        (0.03, 0.03, pytest.approx(0.5)),
    ]
    inside = replace(one, sizes=SizeDistribution((SizeClass(0.016, 0.016, 1.0),)))
    halves = mixed_sizes((MaterialPart(load_material("pellet"), 0.5), MaterialPart(inside, 0.5))).classes
    assert [c.mass_share for c in halves] == pytest.approx([0.25, 0.5, 0.25])


@pytest.mark.parametrize(
    ("build", "field"),
    [
        (lambda: iron(1.0), "parts.mass_share"),
        (
            lambda: mixed("two", (MaterialPart(iron(), 0.5), MaterialPart(load_material("coke"), 0.5))),
            "parts",
        ),
        (lambda: mixed("same", (MaterialPart(load_material("coke"), 0.5),) * 2), "parts"),
        (lambda: mixed("none", ()), "parts"),
        (lambda: replace(iron(), sizes=load_material("coke").sizes), "sizes"),
    ],
)
def test_a_mix_that_makes_no_sense_is_refused(build, field):
    with pytest.raises(InputError) as caught:
        build()
    assert caught.value.field == field

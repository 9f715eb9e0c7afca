"""Materials: what the paper publishes must hold of the classes that we assume; sampling keeps the shares."""

from __future__ import annotations

import math

import numpy as np
import pytest

from demcore.errors import InputError
from demcore.material import SizeClass, SizeDistribution, coarse_grain, cut_off, load_material, material_names
from demcore.rig import load_rig, rig_names


def test_the_papers_materials_and_rigs_are_shipped():
    assert material_names() == ("coke", "sinter", "pellet")
    assert rig_names() == ("coke", "sinter", "pellet")
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

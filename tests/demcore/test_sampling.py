"""Mass right to one particle, for many rates and seeds; shares of mixes and of size classes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from demcore.interaction import grain_rows
from demcore.material import MixPart, load_material
from demcore.sampling import bulk_density, components, draw_mass
from tests.demcore.cases import GRAVEL, SAND

GRAINS = (GRAVEL, SAND)
BOTH = (MixPart("gravel", 0.65), MixPart("sand", 0.35))


def draw(mass, seed=1, mix=BOTH, grains=GRAINS):
    return draw_mass(components(mix, grains, grain_rows(grains, 1)), mass, np.random.default_rng(seed))


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("mass", [0.003, 0.02, 0.7, 7.0, 33.3])
def test_the_mass_is_right_to_one_particle(mass, seed):
    drawn = draw(mass, seed)
    # Half a particle is the most that is missing or too much: of gravel of 16 mm, which has 5.4 g.
    heaviest = 2500.0 * math.pi / 6.0 * 0.016**3
    assert abs(drawn.mass.sum() - mass) <= 0.5 * heaviest
    # m = rho 4/3 pi r^3
    assert drawn.mass == pytest.approx(drawn.density * 4.0 / 3.0 * math.pi * drawn.radius**3)


def test_less_than_a_particle_is_one_particle():
    assert len(draw(1e-9).mass) == 1


def test_a_mix_holds_its_shares_and_those_of_the_restitutions_at_walls():
    drawn = draw(40.0)
    share = np.bincount(drawn.row, drawn.mass, 4) / drawn.mass.sum()
    assert share[1:] == pytest.approx([0.65 * 0.25, 0.65 * 0.75, 0.35], abs=2e-3)
    assert set(drawn.density[drawn.row == 3]) == {2600.0}
    assert set(drawn.density[drawn.row < 3]) == {2500.0}


def test_every_stretch_of_a_mix_holds_its_shares():
    drawn = draw(40.0)
    came = np.cumsum(drawn.mass)
    sand = np.cumsum(np.where(drawn.row == 3, drawn.mass, 0.0))
    # Three components in turn: none runs ahead by more than a few particles.
    assert np.abs(sand - 0.35 * came).max() < 4.0 * drawn.mass.max()


def test_the_papers_iron_is_65_percent_sinter_and_35_percent_pellet_by_mass():
    grains = (load_material("sinter"), load_material("pellet"))
    mix = (MixPart("sinter", 0.65), MixPart("pellet", 0.35))
    drawn = draw(60.0, mix=mix, grains=grains)
    sinter = drawn.row <= 2
    assert drawn.mass[sinter].sum() / drawn.mass.sum() == pytest.approx(0.65, abs=0.01)
    assert drawn.radius[~sinter].max() <= 0.011
    assert drawn.radius[sinter].max() > 0.03
    # lying side by side: 1 / (.65 / 1863 + .35 / 2088)
    assert bulk_density(mix, grains) == pytest.approx(1936.0, rel=1e-3)


def test_size_classes_hold_their_mass_shares():
    coke = load_material("coke")
    drawn = draw(500.0, mix=(MixPart("coke"),), grains=(coke,))
    d = 2.0 * drawn.radius
    for c in coke.sizes.classes:
        inside = drawn.mass[(d >= c.lower) & (d < c.upper)].sum() / drawn.mass.sum()
        assert inside == pytest.approx(c.mass_share, abs=0.012)


def test_a_seed_is_a_draw():
    assert draw(1.0, 5).radius.tobytes() == draw(1.0, 5).radius.tobytes()
    assert draw(1.0, 5).radius.tobytes() != draw(1.0, 6).radius.tobytes()

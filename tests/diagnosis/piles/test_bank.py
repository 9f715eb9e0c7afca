"""The bank of another code's piles: its readers against published numbers, its data sets, its inputs."""

from __future__ import annotations

import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from service.domain.data_set.reading import read_data_set
from service.domain.data_set.suitability import suitability
from tests.diagnosis.piles.bank import (
    BANK,
    CONDITIONS,
    REPLICATES,
    data_set,
    draw_hidden,
    draw_truth,
    free_sets,
    pile_of,
    scored_sets,
    truth_of,
    write_tables,
)
from tests.diagnosis.piles.heap_reading import angle_of, readings, surface
from tests.diagnosis.piles.liggghts_pile import Heap, input_script, loose_column, run, sizes, time_step

DATA = Path(__file__).parents[2] / "data"
TRUTH = draw_truth(1, {})


@pytest.mark.parametrize(("seed", "expected"), [(1, 35.60), (2, 35.43)])
def test_the_scan_reads_the_reference_piles(seed: int, expected: float) -> None:
    """The angles of tests/data/README.md, read by another program before either reader existed."""
    with np.load(DATA / f"liggghts_pile_seed{seed}.npz") as file:
        heap = Heap(
            file["position"].astype(float), file["radius"].astype(float), 1.0, np.zeros(1), np.ones(1)
        )
    assert angle_of(*surface(heap, 0.375), 0.375) == pytest.approx(expected, abs=0.1)


def test_a_single_sphere_is_read_by_hand() -> None:
    """At (.1, 0) with radius .05 on a plate of .3: apex at its top, all mass on the plate."""
    pile = pile_of(CONDITIONS[0], TRUTH, 0)
    heap = Heap(
        np.array([[0.1, 0.0, 0.05]]),
        np.array([0.05]),
        0.4,
        np.array([0.0, 1.0, 2.0]),
        np.array([4.0, 2.1, 2.0]),
    )
    values, heights = readings(pile, heap)
    assert values["apex_height_m"] == pytest.approx(0.1, abs=1e-3)
    assert values["mass_on_base_kg"] == pytest.approx(pile.density * 4 / 3 * math.pi * 0.05**3)
    assert values["heap_offset_x_m"] == pytest.approx(0.1)
    assert values["discharge_t90_s"] == 1.0  # 1.9 of the 2 kg that leave
    assert values["bulk_density_kg_m3"] == pytest.approx(4.0 / (math.pi * 0.175**2 * 0.4))
    assert heights.max() < 0.1 and heights.min() == 0.0


def test_where_nothing_leaves_no_time_is_measured(tmp_path: Path) -> None:
    """As behind a rim: the cell is missing, as it would be in a laboratory's table."""
    pile = pile_of(CONDITIONS[0], TRUTH, 0)
    heap = Heap(
        np.array([[0.1, 0.0, 0.05]]), np.array([0.05]), 0.4, np.array([0.0, 1.0]), np.array([4.0, 4.0])
    )
    assert math.isnan(readings(pile, heap)[0]["discharge_t90_s"])
    shutil.copy(BANK / "case_01.npz", tmp_path / "case_01.npz")
    write_tables(data_set("case_01", tmp_path), tmp_path / "tables")
    given = read_data_set(tmp_path / "tables")
    times = [o.value for o in given.observations if o.observable == "discharge_t90_s"]
    assert 0 < len(times) < len(CONDITIONS) * REPLICATES and min(times) > 0.0


@pytest.mark.parametrize("spread", [0.2, 0.35])
def test_a_wider_sample_keeps_its_median_by_mass(spread: float) -> None:
    """Variances of ln d add; grains are cut at .4 and 2 medians, which takes less than a twentieth off the sd."""
    narrow, wide = (
        sizes(replace(pile_of(CONDITIONS[0], TRUTH, 0), mass=6000.0, spread=a), np.random.default_rng(1))
        for a in (0.0, spread)
    )

    def moments(d: np.ndarray) -> tuple[float, float]:
        mass, ln = d**3 / np.sum(d**3), np.log(d)
        mean = float(mass @ ln)
        return mean, math.sqrt(mass @ (ln - mean) ** 2)

    (mean, sd), (mean_wide, sd_wide) = moments(narrow), moments(wide)
    assert mean_wide == pytest.approx(mean, abs=0.03)
    assert sd_wide == pytest.approx(math.hypot(sd, spread), rel=0.05)


def test_the_column_is_loose_and_of_the_stated_mass() -> None:
    pile, stream = pile_of(CONDITIONS[0], TRUTH, 0), np.random.default_rng(3)
    d = sizes(pile, stream)
    assert np.sum(pile.density * math.pi / 6 * d**3) == pytest.approx(pile.mass, rel=0.02)
    column = loose_column(d, pile.cylinder_radius, pile.density, stream)
    gap = np.linalg.norm(column[:, None, :3] - column[None, :, :3], axis=2)
    gap -= column[:, None, 3] + column[None, :, 3]
    assert gap[np.triu_indices(len(column), 1)].min() > 0.0
    assert (np.hypot(column[:, 0], column[:, 1]) + column[:, 3]).max() < pile.cylinder_radius


def test_the_input_says_what_is_hidden() -> None:
    pile = pile_of(CONDITIONS[0], TRUTH, 0)
    column = np.array([[0.0, 0.0, 0.1, 0.02], [0.0, 0.0, 0.2, 0.03]])
    assert "sjkr" not in input_script(pile, column) and "tube" not in input_script(pile, column)
    wet = input_script(replace(pile, surface_tension=7.0), column)
    assert "tangential history cohesion sjkr rolling_friction" in wet  # the order that it asks for
    rough = input_script(replace(pile, base_friction=0.9), column)
    assert "0.9" in next(line for line in rough.splitlines() if "coefficientFriction" in line)
    assert "move/mesh mesh tube linear 0.0 0.0 0.4" in input_script(replace(pile, lift=0.4), column)
    assert time_step(replace(pile, density=4 * pile.density), 0.02) == pytest.approx(
        2 * time_step(pile, 0.02)
    )


def test_a_clump_is_two_spheres_less_their_lens() -> None:
    """Touching spheres hold twice one's volume; with middles half a diameter apart 27/16 of it (caps of r/2)."""
    pile = pile_of(CONDITIONS[0], TRUTH, 0)
    assert pile.grain_per_sphere == 1.0
    for apart, volume in ((1.0, 2.0), (0.5, 27.0 / 16.0)):
        clump = replace(pile, clump=apart)
        assert clump.grain_per_sphere**3 == pytest.approx(volume)
        assert 2.0 * clump.mass_per_sphere == pytest.approx(volume * pile.mass_per_sphere)
    column = np.array([[0.0, 0.0, 0.1, 0.02], [0.0, 0.0, 0.2, 0.03]])
    script = input_script(replace(pile, clump=0.5), column)
    assert "read_data" not in script and "nve/sphere" not in script
    templates = [line.split() for line in script.splitlines() if "particletemplate" in line]
    assert len(templates) == 9
    for words in templates:
        seed, at = int(words[4]), words.index("spheres") + 1
        left, right = float(words[at]), float(words[at + 4])
        assert seed > 10_000 and all(seed % d for d in range(2, 200))
        assert (right - left) / (2.0 * float(words[at + 3])) == pytest.approx(0.5)
    # The middle one of a class has the volume of the stated size.
    diameter = 2.0 * float(templates[1][templates[1].index("spheres") + 4])
    assert 27.0 / 16.0 * diameter**3 == pytest.approx(0.04**3)


def test_a_third_of_the_scored_sets_hides_nothing_that_a_calibration_leaves() -> None:
    causes = list(scored_sets().values())
    assert len(causes) >= 40
    assert sum(cause in ("null", "decoy") for cause in causes) >= len(causes) / 3 - 1
    assert {"rim", "one_mass"} <= set(causes)  # outside the library
    plain, decoy = draw_truth(5, {}), draw_truth(5, {}, decoy=True)
    assert decoy.contacts.friction == pytest.approx(1.3 * plain.contacts.friction, abs=1e-3)
    assert decoy.hidden == {}


def test_a_cause_touches_what_it_says_and_nothing_else() -> None:
    plain = [pile_of(c, TRUTH, 0) for c in CONDITIONS]
    steel = TRUTH.contacts.wall_friction
    for hidden, changed in (
        ({"base_rough": 0.2}, {"base_friction": steel + 0.2}),
        ({"wide_psd": 0.3}, {"spread": 0.3}),
        ({"shape_roll": 0.4}, {"clump": 0.4}),
        ({"rim": 0.05}, {"rim": 0.05}),
    ):
        for c, pile in zip(CONDITIONS, plain, strict=True):
            assert pile_of(c, replace(TRUTH, hidden=hidden), 0) == replace(pile, **changed)  # type: ignore[arg-type]
    wrong = [pile_of(c, replace(TRUTH, hidden={"one_mass": -0.2}), 0) for c in CONDITIONS]
    assert [made.mass / pile.mass for made, pile in zip(wrong, plain, strict=True)] == pytest.approx(
        [1.0, 1.0, 0.8, 1.0, 1.0, 1.0]
    )


def test_only_wet_conditions_get_bridges_and_only_lifted_ones_another_speed() -> None:
    cohesion, lift = (replace(TRUTH, hidden=hidden) for hidden in ({"cohesion": 1.5}, {"lift_speed": 0.5}))
    for c in CONDITIONS:
        assert (pile_of(c, cohesion, 0).surface_tension > 0.0) == (c.moisture_percent > 0.0)
        stated = c.lift_speed_m_s if c.removal == "lift" else 0.0
        assert pile_of(c, lift, 0).lift == pytest.approx(stated * math.exp(0.5))
    # The Bond number of the library, 1.5 gamma / (rho g R^2).
    gamma = pile_of(CONDITIONS[2], cohesion, 0).surface_tension
    assert 1.5 * gamma / (3480.0 * 9.81 * 0.025**2) == pytest.approx(1.5)
    assert draw_hidden("cohesion", 5) == draw_hidden("cohesion", 5) != draw_hidden("cohesion", 6)


@pytest.mark.parametrize("name", free_sets())
def test_a_stored_data_set_is_one_of_a_laboratory(name: str, tmp_path: Path) -> None:
    assert truth_of(name).hidden == {}
    data = data_set(name)
    assert all(len(found) == REPLICATES for found in data.replicates.values())
    judged = suitability(data)
    assert judged.usable is not None and judged.sentences == ()
    write_tables(data, tmp_path)
    again = read_data_set(tmp_path)
    assert again.conditions == data.conditions
    assert again.observations == data.observations
    assert len(again.profiles) == len(data.profiles)


@pytest.mark.slow
@pytest.mark.skipif(
    shutil.which("liggghts") is None, reason="needs LIGGGHTS (Debian: apt-get install liggghts)"
)
def test_the_bank_can_be_made_again() -> None:
    """One run of one set, to the numbers that are stored."""
    name = free_sets()[0]
    pile = pile_of(CONDITIONS[0], truth_of(name), 0)
    values, _ = readings(pile, run(pile))
    stored = {
        o.observable: o.value
        for o in data_set(name).observations
        if o.condition == "full" and o.replicate == "1"
    }
    for observable, value in values.items():
        assert value == pytest.approx(stored[observable], rel=1e-4), observable
    assert (BANK / f"{name}.npz").stat().st_size < 50_000


@pytest.mark.slow
@pytest.mark.skipif(
    shutil.which("liggghts") is None, reason="needs LIGGGHTS (Debian: apt-get install liggghts)"
)
def test_a_pile_of_clumps_has_the_stated_mass() -> None:
    """The program fills by its own volumes of the templates; a grain less or more, and sampling in them."""
    pile = replace(pile_of(CONDITIONS[0], TRUTH, 0), clump=0.5, mass=20.0)
    heap = run(pile)
    assert heap.mass[0] == pytest.approx(20.0, rel=0.03)
    assert len(heap.radius) % 2 == 0

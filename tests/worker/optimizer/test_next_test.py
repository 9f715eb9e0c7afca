"""Preposterior analysis against the Gaussian in closed form, and what a study says of further tests."""

from __future__ import annotations

import math

import numpy as np
import pytest

from service.domain.search_space import SearchSpace, Variable
from service.domain.study import StudySpec
from tests.worker.optimizer.studies import PP, PW, ROLL
from tests.worker.optimizer.test_posterior import grid_history, response, study
from worker.optimizer.next_test import (
    DIRECT_TESTS,
    TestValue,
    expected_sds,
    parameter_values,
    which_test_next,
)
from worker.optimizer.posterior import beliefs, draw


def weigh(spec: StudySpec, of: dict, levels: int = 6, **given: object) -> dict[str, TestValue]:
    known = beliefs(spec, grid_history(of, spec.space.dimension, levels))
    assert known is not None
    values = which_test_next(known, draw(known, 16384), **given)  # type: ignore[arg-type]
    overall = [v.overall for v in values]
    assert overall == sorted(overall, reverse=True)
    return {v.test: v for v in values}


def test_a_linear_test_of_a_gaussian_shrinks_as_the_textbook_says() -> None:
    """u ~ N(0, s^2) and y = a u + N(0, tau^2): the posterior sd is s tau / sqrt(tau^2 + a^2 s^2), whatever y."""
    rng = np.random.default_rng(5)
    u = rng.normal(0.0, [[0.2, 0.3]], (20_000, 2))
    for tau in (0.5, 2.0, 8.0):
        sds = expected_sds(u, 20.0 * u[:, 0], np.full(len(u), tau), np.random.default_rng(1), 256)
        assert sds[0] == pytest.approx(0.2 * tau / math.hypot(tau, 20.0 * 0.2), rel=0.05)
        assert sds[1] == pytest.approx(0.3, rel=0.03)


def test_the_test_that_sees_the_open_direction_comes_first() -> None:
    """The angle fixes the sum; the mass sees the difference, the discharge the sum again."""
    spec = study(response("angle_deg", 40.0, 0.5))
    found = weigh(
        spec,
        {
            "angle_deg": lambda a, b: 20.0 + 20.0 * (a + b),
            "mass_on_base_kg": lambda a, b: 30.0 + 20.0 * (a - b),
            "discharge_t90_s": lambda a, b: 1.0 + (a + b),
        },
    )
    assert next(iter(found)) == "mass_on_base_kg"
    assert "angle_deg" not in found
    mass = found["mass_on_base_kg"]
    assert max(mass.sd_ratios.values()) < 0.35
    assert min(found["discharge_t90_s"].sd_ratios.values()) > 0.85
    # On the line a + b = 1 the mass ranges over 10 to 50.
    assert mass.expected == pytest.approx(30.0, abs=1.0)
    assert mass.expected_sd == pytest.approx(40.0 / math.sqrt(12.0), rel=0.15)


def test_a_worse_laboratory_learns_less() -> None:
    spec = study(response("angle_deg", 40.0, 0.5))
    of = {
        "angle_deg": lambda a, b: 20.0 + 20.0 * (a + b),
        "mass_on_base_kg": lambda a, b: 30.0 + 20.0 * (a - b),
    }
    overall = [
        weigh(spec, of, lab_sds={"mass_on_base_kg": sd})["mass_on_base_kg"].overall for sd in (1, 5, 50)
    ]
    assert overall[0] > overall[1] > overall[2]
    assert overall[2] < 0.1


def test_wall_friction_that_no_pile_shows_is_left_to_a_tilted_plate() -> None:
    spec = study(response("angle_deg", 30.0, 0.5), dimension=3)
    found = weigh(spec, {"angle_deg": lambda a, b, _w: 20.0 + 10.0 * (a + b)}, levels=4)
    tilt = found["wall_friction_angle_deg"]
    assert tilt.best == PW
    assert tilt.source == "closed form"
    # mu = tan(angle), uniform from 0 to 1: sd .289 before; one degree is (1 + mu^2) pi/180, .023 on average.
    assert tilt.sd_ratios[PW] == pytest.approx(0.0233 / 0.289, rel=0.15)
    assert tilt.sd_ratios[PP] > 0.85
    assert "rebound_height_ratio" not in found, "restitution is no variable of this study"


def test_relations_of_the_direct_tests_are_those_of_physics_md() -> None:
    values = {
        PW: np.array([1.0, 0.2]),
        ROLL: np.array([0.35, 0.35]),
        "particle_particle_restitution": np.array([0.5, 0.8]),
    }
    shown = {name: test.relation(values) for name, test in DIRECT_TESTS.items()}
    assert shown["wall_friction_angle_deg"][0] == pytest.approx(45.0)
    # physics.md section 3: with mu_r = .35 a sphere stays at 19 degrees and rolls at 20.
    assert 19.0 < shown["rolling_angle_deg"][0] < 20.0
    assert shown["rolling_angle_deg"][1] == pytest.approx(math.degrees(math.atan(0.2)))
    assert shown["rebound_height_ratio"].tolist() == pytest.approx([0.25, 0.64])


def test_parameters_that_are_fixed_or_derived_take_part() -> None:
    box = SearchSpace((Variable(PP, 0.0, 1.0),))
    spec = StudySpec(
        "test",
        1.0,
        box,
        (response("angle_deg", 30.0, 1.0),),
        fixed={ROLL: 0.2},
        derived={PW: f"0.5 * {PP}"},
    )
    values = parameter_values(spec, np.array([[0.2], [0.8]]))
    assert values[PW].tolist() == pytest.approx([0.1, 0.4])
    assert values[ROLL].tolist() == [0.2, 0.2]

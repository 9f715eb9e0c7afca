"""The report as it is stored: plain JSON, whole, fast, the same again; and its silence before there is enough."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from itertools import combinations

import numpy as np
from threadpoolctl import threadpool_limits

from service.domain.search_space import default_space
from service.domain.study import Response, StudySpec
from worker.optimizer.design import sobol
from worker.optimizer.history import Design, History
from worker.optimizer.report import DRAWS, MEMBERS, VERSION, study_report
from worker.optimizer.synthetic import crash_probability, true_angle

SPEC = StudySpec("coke", 2.0, default_space(), (Response("angle_deg", 36.5, (35.0, 38.0), 0.5),))
WALL = "particle_wall_static_friction"


def history(count: int) -> History:
    """calibration.md's synthetic angle, and a mass that wall friction moves."""
    rng = np.random.default_rng(3)
    designs = []
    for i, u in enumerate(sobol(4, count, 9, 9).tolist()):
        x = SPEC.space.from_unit(u)
        point = np.array([x])
        angle = float(true_angle(point)[0]) + 0.5 * rng.normal()
        crashed = rng.random() < crash_probability(point)[0]
        results = {"angle_deg": angle, "mass_on_base_kg": 20.0 + 8.0 * x[1] + 0.2 * rng.normal()}
        designs.append(Design(i + 1, x, i, None if crashed else results, "doe"))
    return History(tuple(designs))


def test_a_report_is_whole_and_plain() -> None:
    known = history(24)
    report = study_report(SPEC, known, points=8192)
    assert json.loads(json.dumps(report, allow_nan=False)) == report
    assert report["version"] == VERSION and report["enough"] is True
    assert report["designs"] == {
        "finished": 24,
        "failed": known.failures,
        "with_results": 24 - known.failures,
    }
    names = list(SPEC.space.names)
    assert [p["name"] for p in report["posterior"]["parameters"]] == names
    assert len(report["posterior"]["text"]) >= len(names)
    assert set(report["optimum"]["x"]) == set(names)
    assert len(report["ensemble"]["members"]) == MEMBERS
    assert [e["name"] for e in report["sensitivity"]["angle_deg"]] == names
    assert [s["names"] for s in report["slices"]["along"]] == [[n] for n in names]
    over = report["slices"]["over"]
    assert len(over["means"]) == len(over["axes"][0]) and len(over["means"][0]) == len(over["axes"][1])
    pairs = report["slices"]["pairs"]
    assert {frozenset(p["names"]) for p in pairs} == {frozenset(p) for p in combinations(names, 2)}
    assert pairs[0]["names"] == over["names"]
    np.testing.assert_allclose(pairs[0]["means"], over["means"], rtol=5e-4)
    said = {test["test"]: test for test in report["which_test_next"]}
    assert said["mass_on_base_kg"]["source"].startswith("emulator of")
    assert min(said["mass_on_base_kg"]["sd_ratios"], key=said["mass_on_base_kg"]["sd_ratios"].get) == WALL
    assert report["which_test_next_assumes"]


def test_draws_have_the_moments_of_the_posterior() -> None:
    """400 draws of equal weight: means within four standard errors, and all inside the box."""
    found = study_report(SPEC, history(24), points=8192)["posterior"]
    draws = found["draws"]
    x = np.array(draws["x"])
    assert x.shape == (DRAWS, 4) and len(draws["means"]) == DRAWS
    for column, name in enumerate(draws["names"]):
        told = next(p for p in found["parameters"] if p["name"] == name)
        variable = SPEC.space.variables[column]
        assert variable.lower <= x[:, column].min() <= x[:, column].max() <= variable.upper
        assert abs(x[:, column].mean() - told["mean"]) < 4.0 * told["sd"] / np.sqrt(DRAWS)
        assert abs(x[:, column].std() / told["sd"] - 1.0) < 0.2
    # The window is the target and 1.5 degrees about it.
    assert np.median(np.abs(np.array(draws["means"]) - 36.5)) < 1.5


def test_the_angle_leaves_wall_friction_open_and_the_mass_closes_it() -> None:
    """calibration.md: one angle leaves wall friction and restitution where the prior put them."""
    known = history(40)
    both = replace(
        SPEC, responses=(*SPEC.responses, Response("mass_on_base_kg", 24.0, (23.0, 25.0), 0.4, 0.3))
    )
    ratios = [
        {p["name"]: p["sd_ratio"] for p in study_report(spec, known, points=8192)["posterior"]["parameters"]}
        for spec in (SPEC, both)
    ]
    assert ratios[0][WALL] > 0.8
    assert ratios[1][WALL] < 0.35


def test_the_same_study_gives_the_same_report() -> None:
    known = history(16)
    assert study_report(SPEC, known, points=2048) == study_report(SPEC, known, points=2048)


def test_too_few_results_are_said_to_be_too_few() -> None:
    report = study_report(SPEC, History(history(24).finished[:2]))
    assert report["enough"] is False
    assert "three designs" in report["text"]
    failed = tuple(replace(d, results=None) for d in history(24).finished)
    assert study_report(SPEC, History(failed))["designs"]["failed"] == 24


def test_two_hundred_designs_take_seconds() -> None:
    """Two seconds of one quiet core; the limit leaves room for a busy machine."""
    known = history(200)
    study_report(SPEC, History(known.finished[:16]), points=256)  # imports
    # Threads of a matrix library that wait for a busy core count as work of this process.
    with threadpool_limits(1):
        began = time.process_time()
        study_report(SPEC, known)
        assert time.process_time() - began < 8.0

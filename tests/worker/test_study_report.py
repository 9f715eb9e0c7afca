"""From a stored history to its report: other observables count, time steps and literature are demcore's."""

from __future__ import annotations

import json

import pytest

from demcore.experiments.paper_tables import TABLE_5
from service.domain.history import FinishedDesign, StudyHistory
from service.domain.search_space import SearchSpace, Variable
from service.domain.study import Response, StudySpec
from worker.study_report import literature, report_of, time_step_of, time_step_s

SPACE = SearchSpace(
    (
        Variable("particle_particle_restitution", 0.1, 0.6, 0.01),
        Variable("rolling_resistance", 0.05, 0.6, 0.01),
    )
)


def a_study(**changes: object) -> StudySpec:
    response = Response("angle_deg", 30.0, (29.0, 31.0), 0.5)
    return StudySpec("pellet", 4.0, SPACE, (response,), **changes)  # type: ignore[arg-type]


def test_time_steps_are_those_of_the_pile_test() -> None:
    """The preset `paper` takes an eighth of the unloading time, which goes with e (physics.md section 1)."""
    paper, fast = a_study(time_step="paper"), a_study()
    # Above .28 the wall's own restitution of .2 limits it.
    assert time_step_s(paper, (0.12, 0.3)) == pytest.approx(0.5 * time_step_s(paper, (0.24, 0.3)))
    assert time_step_s(fast, (0.2, 0.3)) == time_step_s(fast, (0.4, 0.3))
    ask = time_step_of(paper)
    assert [ask(x) for x in ((0.2, 0.3), (0.2, 0.5), (0.4, 0.3))] == [
        time_step_s(paper, x) for x in ((0.2, 0.3), (0.2, 0.3), (0.4, 0.3))
    ]


def test_a_design_that_contradicts_itself_has_no_time_step() -> None:
    spec = a_study(
        fixed={"particle_wall_static_friction": 0.2, "particle_wall_dynamic_friction": 0.3},
    )
    assert time_step_s(spec, (0.2, 0.3)) == 0.0


def test_literature_is_table_5() -> None:
    found = literature("pellet")
    assert found is not None
    assert tuple(found.values()) == TABLE_5["pellet"]
    assert literature("gravel") is None


def test_a_report_weighs_what_every_pile_yields() -> None:
    """Mass on the base sees restitution, which the angle does not; it is no response, and yet was measured."""
    finished = tuple(
        FinishedDesign(
            number=i + 1,
            x=(0.1 + 0.1 * (i % 6), 0.05 + 0.1 * (i // 6)),
            seed=i,
            results={
                "angle_deg": 20.0 + 4.0 * (i // 6),
                "mass_on_base_kg": 30.0 + 5.0 * (i % 6),
            },
            origin="doe",
            scale=4.0,
        )
        for i in range(36)
    )
    report = report_of(StudyHistory(a_study(), 37, finished, ()), members=3)
    json.dumps(report, allow_nan=False)
    tests = {row["test"]: row for row in report["which_test_next"]}
    assert tests["mass_on_base_kg"]["sd_ratios"]["particle_particle_restitution"] < 0.35
    assert len(report["ensemble"]["members"]) == 3
    assert report["optimum"]["distance_to_literature"] is not None
    assert report["optimum"]["time_step_s"] == pytest.approx(time_step_s(a_study(), (0.2, 0.3)))

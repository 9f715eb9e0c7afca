"""A study's spec as stored JSON, of today and of the first version."""

from __future__ import annotations

import json

from service.domain.search_space import SearchSpace, Variable
from service.domain.spec_record import (
    design_hash,
    primary_response,
    spec_from_record,
    spec_to_record,
    upgraded,
)
from service.domain.study import CoarsePrior, Response, TableRow
from tests.builders.studies import a_spec

# Written by the version before responses and strategies (commit 730d58e). Its tolerance is one that a new study
# would not get.
FIRST_VERSION = """
{"material": "coke", "scale": 3.0, "budget": 12, "initial_designs": 6, "replicates": 3, "parallel": 2, "seed": 7,
 "fill_level": 1.0, "time_step": "paper",
 "objective": {"target_deg": 36.5, "window_deg": [35.0, 38.0], "tolerance_deg": 0.1},
 "variables": {"rolling_resistance": {"lower": 0.1, "upper": 0.4, "step": null},
               "particle_wall_static_friction": {"lower": 0.1, "upper": 0.9, "step": 0.01}},
 "fixed": {"particle_particle_restitution": 0.3}}
"""


def test_a_spec_survives_being_stored() -> None:
    space = SearchSpace((Variable("rolling_resistance", 0.1, 0.4, None),))
    row = TableRow({"rolling_resistance": 0.2}, {"angle_deg": 25.0, "mass_on_base_kg": 3.0})
    spec = a_spec(
        space=space,
        responses=(
            Response("mass_on_base_kg", 3.0, (2.5, 3.5), 0.2, 0.1),
            Response("angle_deg", 25.5, (25.0, 26.0), 0.5),
        ),
        fixed={"particle_particle_restitution": 0.3},
        derived={"particle_wall_static_friction": "0.9 * rolling_resistance"},
        table=(row,),
        coarse=CoarsePrior(4.0, 8),
        warm_start=(3, 1),
        seed=7,
        time_step="paper",
    )
    assert spec_from_record(json.loads(json.dumps(spec_to_record(spec)))) == spec
    table = a_spec(space=space, strategy="table", table=(TableRow({"rolling_resistance": 0.3}), row))
    assert spec_from_record(json.loads(json.dumps(spec_to_record(table)))) == table


def test_a_record_of_the_first_version_is_the_study_that_it_was() -> None:
    stored = json.loads(FIRST_VERSION)
    spec = spec_from_record(stored)
    assert spec.responses == (Response("angle_deg", 36.5, (35.0, 38.0), 0.1),)
    assert (spec.strategy, spec.derived, spec.table, spec.coarse, spec.warm_start) == (
        "auto",
        {},
        (),
        None,
        (),
    )
    assert spec.space.variables[0] == Variable("rolling_resistance", 0.1, 0.4, None)
    assert (spec.budget, spec.seed, spec.time_step, spec.scale) == (12, 7, "paper", 3.0)
    assert dict(spec.fixed) == {"particle_particle_restitution": 0.3}
    assert upgraded(stored) == spec_to_record(spec)
    assert primary_response(stored)["window"] == [35.0, 38.0]
    assert "objective" in stored, "what is stored is not changed"


def test_the_key_of_a_design_does_not_depend_on_what_is_searched_and_what_is_fixed() -> None:
    space = SearchSpace((Variable("rolling_resistance", 0.1, 0.4),))
    fixed = {"particle_wall_static_friction": 0.45, "particle_particle_static_friction": 0.5}
    derived = {"particle_wall_static_friction": "0.9 * particle_particle_static_friction"}
    rest = {"particle_particle_static_friction": 0.5}
    key = design_hash(a_spec(space=space, fixed=fixed).parameters_of((0.2,)))
    assert design_hash(a_spec(space=space, fixed=rest, derived=derived).parameters_of((0.2,))) == key
    assert design_hash(a_spec(space=space, fixed=fixed).parameters_of((0.3,))) != key

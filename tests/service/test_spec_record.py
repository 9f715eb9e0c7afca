"""A study's spec as stored JSON."""

from __future__ import annotations

import json

from service.domain.search_space import SearchSpace, Variable
from service.domain.spec_record import design_hash, spec_from_record, spec_to_record
from tests.builders.studies import a_spec


def test_a_spec_survives_being_stored() -> None:
    space = SearchSpace((Variable("rolling_resistance", 0.1, 0.4, None),))
    spec = a_spec(space=space, fixed={"particle_particle_restitution": 0.3}, seed=7, time_step="paper")
    assert spec_from_record(json.loads(json.dumps(spec_to_record(spec)))) == spec


def test_the_key_of_a_design_does_not_depend_on_what_is_searched_and_what_is_fixed() -> None:
    searched = design_hash(["a", "b"], [0.1, 0.2], {})
    assert design_hash(["b"], [0.2], {"a": 0.1}) == searched
    assert design_hash(["a", "b"], [0.2, 0.1], {}) != searched

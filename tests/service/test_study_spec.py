"""What a study may ask for: every refusal is one InvalidValue that names the field and what is allowed."""

from __future__ import annotations

from typing import Any

import pytest

from service.domain.errors import InvalidValue
from service.domain.observables import OBSERVABLES, NoiseLevel, read_observables
from service.domain.outcome import judge
from service.domain.search_space import FURTHER_PARAMETERS, SearchSpace, Variable, default_space
from service.domain.states import Verdict
from service.domain.study import CoarsePrior, Response, StudySpec, TableRow, refuse_tolerance_below_noise
from tests.builders.studies import a_spec

PP, PW = "particle_particle_static_friction", "particle_wall_static_friction"
ROLL = "rolling_resistance"
ANGLE = Response("angle_deg", 25.5, (25.0, 26.0), 0.5)
MASS = Response("mass_on_base_kg", 4.0, (3.5, 4.5), 0.2, 0.1)
TWO = SearchSpace((Variable(PP, 0.1, 0.9, 0.01), Variable(ROLL, 0.1, 0.5, 0.01)))


def row(pp: float = 0.5, roll: float = 0.2, **results: float) -> TableRow:
    return TableRow({PP: pp, ROLL: roll}, results or None)


REFUSED: dict[str, tuple[dict[str, Any], str, str]] = {
    "no response": ({"responses": ()}, "responses", "at least one"),
    "an observable twice": ({"responses": (ANGLE, ANGLE)}, "responses.observable", "once"),
    "an unknown strategy": ({"strategy": "guess"}, "strategy", "auto, improve_surrogate"),
    "a factorial over the budget": ({"strategy": "factorial", "budget": 3}, "budget", "at least 4"),
    "an array over the budget": ({"strategy": "taguchi", "budget": 3}, "budget", "at least 4"),
    "a table without rows": ({"strategy": "table"}, "table", "at least one row"),
    "a table over the budget": (
        {"strategy": "table", "table": (row(), row(0.6)), "budget": 1},
        "budget",
        "at least 2",
    ),
    "a table without one variable": ({"table": (TableRow({PP: 0.5}),)}, "table.1", ROLL),
    "a table out of the box": ({"table": (row(0.95, angle_deg=25.0),)}, f"table.1.{PP}", "0.1 to 0.9"),
    "a table that lacks a response": (
        {"table": (row(mass_on_base_kg=3.0),)},
        "table.1.results",
        "every response",
    ),
    "rows to run under auto": ({"table": (row(),)}, "table", "strategy table"),
    "a coarse prior that is finer": (
        {"coarse": CoarsePrior(1.5, 8)},
        "coarse.scale",
        "more than the study's own",
    ),
    "a coarse prior of a plain design": (
        {"coarse": CoarsePrior(4.0, 8), "strategy": "sobol"},
        "coarse",
        "only with the strategy auto",
    ),
    "a warm start of a plain design": ({"warm_start": (3,), "strategy": "sobol"}, "warm_start", "auto"),
    "a study twice": ({"warm_start": (3, 3)}, "warm_start", "each study once"),
    "a study that is none": ({"warm_start": (0,)}, "warm_start", "a whole number"),
    "derived: unknown parameter": ({"derived": {"mu": "1"}}, "derived", ROLL),
    "derived: also searched": ({"derived": {PP: "0.5"}}, f"derived.{PP}", "not also a variable"),
    "derived: of a name that nobody gives": (
        {"derived": {PW: "2 * poisson_ratio"}},
        f"derived.{PW}",
        "a searched, fixed or derived",
    ),
    "derived: of itself": ({"derived": {PW: f"{PW} + 0.1"}}, "derived", "do not depend on themselves"),
    "derived: a cycle": (
        {"derived": {PW: "poisson_ratio", "poisson_ratio": f"0.3 * {PW}"}},
        "derived",
        "do not depend on themselves",
    ),
    "derived: out of its limits at a corner": (
        {"derived": {PW: f"3 * {PP}"}},
        f"derived.{PW}",
        "between 0 and 2",
    ),
    "derived: out of its limits inside": (
        {"derived": {PW: f"0.1 - 10 * ({PP} - 0.1) * (0.9 - {PP})"}},
        f"derived.{PW}",
        "between 0 and 2",
    ),
    "derived: divides by nothing": ({"derived": {PW: f"0.1 / ({PP} - {PP})"}}, f"derived.{PW}", "zero"),
    "derived: is a program": (
        {"derived": {PW: "__import__('os').getpid()"}},
        f"derived.{PW}",
        "sum, product, quotient",
    ),
    "derived: overflows": ({"derived": {PW: f"{PP} * 9 ** 9 ** 9"}}, f"derived.{PW}", "with a value"),
    "derived: complex": ({"derived": {PW: f"(-{PP}) ** 0.5"}}, f"derived.{PW}", "with a finite value"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused(name: str) -> None:
    changes, field, allowed = REFUSED[name]
    with pytest.raises(InvalidValue) as refused:
        a_spec(**{"space": TWO, "responses": (ANGLE,), **changes})
    assert refused.value.field == field
    assert allowed in refused.value.allowed


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        (("weight_kg", 1.0, (0.5, 2.0), 0.1), "responses.observable"),
        (("angle_deg", 95.0, (25.0, 26.0), 0.5), "responses.angle_deg.target"),
        (("angle_deg", 25.5, (float("nan"), 26.0), 0.5), "responses.angle_deg.window.lower"),
        (("angle_deg", 27.0, (25.0, 26.0), 0.5), "responses.angle_deg.target"),
        (("angle_deg", 25.5, (26.0, 25.0), 0.5), "responses.angle_deg.window"),
        (("angle_deg", 25.5, (25.0, 26.0), 0.0), "responses.angle_deg.tolerance"),
        (("angle_deg", 25.5, (25.0, 26.0), 0.5, -1.0), "responses.angle_deg.uncertainty"),
    ],
)
def test_a_wrong_response(arguments: Any, field: str) -> None:
    with pytest.raises(InvalidValue) as refused:
        Response(*arguments)
    assert refused.value.field == field


def test_a_tolerance_under_half_the_noise_is_refused_with_the_noise_that_was_used() -> None:
    narrow = a_spec(responses=(Response("angle_deg", 25.5, (25.0, 26.0), 0.2),))
    with pytest.raises(
        InvalidValue, match=r"at least 0\.25 deg, half the noise between runs \(0\.5 deg, expected\)"
    ):
        refuse_tolerance_below_noise(narrow)
    refuse_tolerance_below_noise(narrow, {"angle_deg": NoiseLevel(0.3, 12)})
    with pytest.raises(InvalidValue, match=r"1\.5 deg, of earlier replicates"):
        refuse_tolerance_below_noise(a_spec(), {"angle_deg": NoiseLevel(1.5, 12)})
    # Nobody knows beforehand how a mass scatters.
    refuse_tolerance_below_noise(a_spec(responses=(MASS,)))


def test_derived_parameters_follow_the_searched_ones() -> None:
    spec = a_spec(
        space=TWO,
        fixed={"particle_particle_restitution": 0.3},
        derived={"particle_wall_rolling_resistance": f"min({PW}, {ROLL})", PW: f"0.9 * {PP}"},
    )
    values = spec.parameters_of((0.5, 0.46))
    assert values[PW] == pytest.approx(0.45)
    assert values["particle_wall_rolling_resistance"] == pytest.approx(0.45)
    assert values["particle_particle_restitution"] == 0.3


def test_a_design_is_feasible_inside_every_window() -> None:
    responses = (ANGLE, MASS)
    assert judge(responses, {"angle_deg": 26.0, "mass_on_base_kg": 3.5}) is Verdict.FEASIBLE
    assert judge(responses, {"angle_deg": 25.5, "mass_on_base_kg": 3.4}) is Verdict.UNFEASIBLE
    assert judge(responses, {"angle_deg": 25.5}) is Verdict.ERROR


def test_observables_are_read_where_the_pile_test_puts_them() -> None:
    found = read_observables({"angle_deg": 25.0, "apex_height_m": 0.2, "discharge_t90_s": None, "steps": 7})
    assert found == {"angle_deg": 25.0, "heap_height_m": 0.2}
    assert read_observables({"angle_deg": float("nan"), "mass_on_base_kg": True}) == {}


def test_every_observable_says_its_unit_in_its_name() -> None:
    suffix = {name: "_" + known.unit.replace("/", "_") for name, known in OBSERVABLES.items()}
    assert all(name.endswith(suffix[name]) or suffix[name] == "_1" for name in OBSERVABLES)


def test_the_default_space_is_the_papers() -> None:
    assert not set(default_space().names) & set(FURTHER_PARAMETERS)


def test_a_study_of_other_parameters() -> None:
    space = SearchSpace(
        (Variable("youngs_modulus_pa", 1e6, 1e7), Variable("dynamic_friction_ratio", 0.5, 1.0))
    )
    assert isinstance(a_spec(space=space), StudySpec)

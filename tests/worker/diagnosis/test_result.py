"""The result's schema: nothing without a null calibration of its design, claims only with a naming verdict."""

from __future__ import annotations

import json

import pytest

from service.domain.errors import InvalidValue
from tests.worker.diagnosis.plants import normals
from worker.diagnosis.analysis import Statistics
from worker.diagnosis.null_calibration import NullCalibration
from worker.diagnosis.result import Amplitude, Claim, Possible, Result

NULL = NullCalibration("design", normals(1, 200, 3))
CLAIM = Claim("cohesion", "cohesion", 0.97, Amplitude(0.3, "1", (0.2, 0.4)))
# The published form, as the design writes it.
KEYS = (
    "verdict claims also_possible not_testable indistinguishable unexplained remainder gain next_measurement cost "
    "model_version"
)


def test_the_published_form_has_exactly_the_keys_of_the_design() -> None:
    found = Result("named", "m1", "design", NULL, claims=(CLAIM,), also_possible=(Possible("density", 0.1),))
    said = json.loads(json.dumps(found.as_dict()))
    assert list(said) == KEYS.split()
    assert said["claims"] == [
        {
            "effect": "cohesion",
            "class": "cohesion",
            "inclusion": 0.97,
            "amplitude": {"value": 0.3, "unit": "1", "ci90": [0.2, 0.4]},
            "level": "named",
        }
    ]
    assert said["also_possible"] == [{"effect": "density", "inclusion": 0.1}]


def test_a_claim_without_a_null_calibration_is_refused() -> None:
    with pytest.raises(InvalidValue, match="null calibration"):
        Result("named", "m1", "design", None, claims=(CLAIM,))
    with pytest.raises(InvalidValue, match="another design"):
        Result("named", "m1", "another", NULL, claims=(CLAIM,))
    with pytest.raises(InvalidValue, match="null calibration"):
        Result("no_misfit", "m1", "design", None)
    assert Result("refused", "m1", "", None).as_dict()["claims"] == []


def test_a_null_calibration_needs_a_hundred_plants() -> None:
    with pytest.raises(InvalidValue, match="at least 100"):
        NullCalibration("design", normals(1, 99, 3))


@pytest.mark.parametrize(("verdict", "claims"), [("named", ()), ("ambiguous", (CLAIM,)), ("sure", ())])
def test_verdict_and_claims_go_together(verdict: str, claims: tuple[Claim, ...]) -> None:
    with pytest.raises(InvalidValue):
        Result(verdict, "m1", "design", NULL, claims=claims)


def test_a_claim_is_likely_and_has_a_level() -> None:
    with pytest.raises(InvalidValue):
        Claim("cohesion", "cohesion", 0.94, CLAIM.amplitude)
    with pytest.raises(InvalidValue):
        Claim("cohesion", "cohesion", 0.99, CLAIM.amplitude, "proved")


def test_p_values_of_null_draws_are_uniform() -> None:
    """Of 1,000 further draws of the same law, 5 % lie below .05: between 2 and 9 % but for once in 10,000."""
    null = NullCalibration("design", normals(2, 400, 3))
    p = [null.p_value(Statistics(*row)) for row in normals(3, 1000, 3).tolist()]
    assert 0.02 < sum(value <= 0.05 for value in p) / 1000.0 < 0.09
    assert 0.40 < sum(value <= 0.5 for value in p) / 1000.0 < 0.60


def test_far_out_is_the_smallest_p_and_far_in_the_largest() -> None:
    assert NULL.p_value(Statistics(50.0, 0.0, 0.0)) == pytest.approx(1.0 / 201.0)
    assert NULL.p_value(Statistics(-50.0, -50.0, -50.0)) == pytest.approx(1.0)
    assert NULL.p_values(Statistics(50.0, -50.0, 0.0)).tolist()[:2] == pytest.approx([1.0 / 201.0, 1.0])
    assert NULL.quantile(0, 1.0) == pytest.approx(float(NULL.statistics[:, 0].max()))

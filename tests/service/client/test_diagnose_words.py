"""What `talus diagnose` prints: plant words for sizes and places, and no verdict that says more than its test."""

from __future__ import annotations

import math
import subprocess
import sys
from typing import Any

from service.client.diagnose import lines

RESULT: dict[str, Any] = {
    "verdict": "named",
    "claims": [],
    "also_possible": [],
    "not_testable": [],
    "unexplained": [],
    "gain": None,
    "next_measurement": [],
    "limits": [
        {"effect": "lift_speed", "detectable_from": math.log(1.8), "unit": "1"},
        {"effect": "density", "detectable_from": 0.083, "unit": "1"},
    ],
    "sentences": [],
}


def test_a_claim_is_told_in_plant_words() -> None:
    size = {"value": math.log(2.0), "unit": "1", "ci90": [math.log(1.6), math.log(2.5)]}
    claim = {"effect": "lift_speed", "inclusion": 0.991, "amplitude": size, "level": "claim"}
    assert lines({**RESULT, "claims": [claim]}) == [
        "The data are consistent with one cause of the library.",
        "The cylinder was lifted at another speed than stated (lift_speed), claim: equivalent to 2.0 (1.6 to 2.5) "
        "times the stated lift speed, in brackets the 90 % interval; inclusion 0.991, within this library.",
    ]


def test_where_is_told_in_plain_words() -> None:
    where = [
        {"block": "summary:pile.toe", "probability": 0.6},
        {"block": "condition:wet", "probability": 0.3},
    ]
    told = lines({**RESULT, "verdict": "unexplained", "unexplained": where})
    assert told[-1] == "Where: radius of the toe of the pile tests 0.60, condition wet 0.30."


def test_no_misfit_says_from_which_size_on_a_cause_would_show() -> None:
    assert lines({**RESULT, "verdict": "no_misfit"}) == [
        "Consistent with the model: nothing larger than the limits of these data was detected.",
        "Shown from: lift_speed: 0.56 or 1.8 times the stated lift speed; density: particle density ±8.3 %.",
    ]


def test_one_likely_cause_is_not_one_of_several() -> None:
    one = lines(
        {**RESULT, "verdict": "ambiguous", "also_possible": [{"effect": "density", "inclusion": 0.9}]}
    )
    assert (
        "one cause is the likeliest, but it is not named" in one[0] and one[1] == "Likeliest: density 0.90."
    )
    two = [{"effect": "density", "inclusion": 0.6}, {"effect": "cohesion", "inclusion": 0.3}]
    told = lines({**RESULT, "verdict": "ambiguous", "also_possible": two})
    assert "which of several causes" in told[0] and told[1] == "Not excluded: density 0.60, cohesion 0.30."


def test_the_words_need_no_mathematics() -> None:
    code = (
        "import sys, service.domain.effect_words, service.domain.verdict_words, service.domain.misfit_words"
    )
    heavy = "{'numpy', 'scipy', 'sqlalchemy', 'pydantic', 'demcore'}"
    subprocess.run([sys.executable, "-c", f"{code}\nassert not {heavy} & set(sys.modules)"], check=True)

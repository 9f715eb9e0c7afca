"""The scorer by hand-made answers: what is right, wrong, useful."""

from __future__ import annotations

from typing import Any

import pytest

from service.domain.data_set.records import DataSet
from tests.diagnosis.hider import Case
from tests.diagnosis.scorer import located, marks, right, score, worth, wrong

EMPTY = DataSet((), ())


def answer(
    verdict: str, *claims: str, possible: tuple[str, ...] = (), where: tuple[str, ...] = ()
) -> dict[str, Any]:
    return {
        "verdict": verdict,
        "claims": [{"effect": name, "inclusion": 0.97} for name in claims],
        "also_possible": [{"effect": name, "inclusion": 0.4} for name in possible],
        "unexplained": [{"block": block} for block in where],
        "remainder": None,
        "gain": None,
    }


def case(kind: str, *hidden: str, snr: float = 8.0, places: frozenset[str] = frozenset()) -> Case:
    return Case(0, kind, snr, EMPTY, dict.fromkeys(hidden, 0.1), places=places)


@pytest.mark.parametrize(
    ("hidden", "said", "value"),
    [
        (case("single", "density"), answer("named", "density"), 1.0),
        (case("single", "base_rough"), answer("named", "liner_wear"), 1.0),
        (case("single", "density"), answer("named", "wide_psd"), -2.0),
        (case("single", "density"), answer("named", "density", "wide_psd"), -2.0),
        (case("single", "density"), answer("no_misfit"), 0.0),
        (case("single", "density"), answer("ambiguous", possible=("density", "wide_psd")), 0.4),
        (case("single", "density"), answer("ambiguous", possible=("shape_roll", "wide_psd")), 0.0),
        (case("single", "density"), answer("ambiguous", possible=("density", "a", "b", "c")), 0.0),
        (case("single", "density"), answer("unexplained"), 0.0),
        (case("pair", "density", "wide_psd"), answer("named", "density", "wide_psd"), 1.0),
        (case("pair", "density", "wide_psd"), answer("named", "density"), 0.5),
        (case("null"), answer("named", "density"), -3.0),
        (case("decoy"), answer("named", "density"), -3.0),
        (case("null"), answer("unexplained"), 0.0),
        (case("outside"), answer("unexplained"), 0.4),
        (case("left_out"), answer("unexplained"), 0.4),
        (case("outside"), answer("named", "density"), -2.0),
    ],
)
def test_utility(hidden: Case, said: dict[str, Any], value: float) -> None:
    assert worth(hidden, said) == value


def test_right_wrong_and_place() -> None:
    both = case("pair", "density", "belt_speed")
    assert right(both, answer("named", "belt_speed", "density")) and not wrong(
        both, answer("named", "density")
    )
    assert not right(case("null"), answer("no_misfit"))
    outside = case("outside", places=frozenset(["condition:P1"]))
    assert located(outside, answer("unexplained", where=("condition:P1", "test:pile")))
    assert not located(outside, answer("unexplained", where=("test:pile", "condition:P1")))
    assert not located(outside, answer("unexplained"))


def test_marks_count_and_bound() -> None:
    pairs = [(case("null"), answer("no_misfit")) for _ in range(99)] + [
        (case("null"), answer("named", "density"))
    ]
    table = {(m.measure, m.kind): m for m in marks(pairs)}
    named = table[("named", "null")]
    assert (named.count, named.value, named.met) == (100, 0.01, True)
    # Clopper and Pearson, one of a hundred: .0005 to .0466 at 90 %.
    assert named.low == pytest.approx(0.000513, rel=0.01) and named.high == pytest.approx(0.0466, rel=0.01)
    assert table[("named right", "single identifiable")].met is None
    assert score(pairs)["utility"] == pytest.approx(-0.03)
    assert set(score(pairs)["marks"][0]) >= {"measure", "kind", "snr", "value", "low", "high", "mark", "met"}

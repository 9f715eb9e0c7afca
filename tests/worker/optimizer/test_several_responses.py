"""Studies with two responses: certified on both, refused on either, and told which target is out of reach."""

from __future__ import annotations

import pytest

from service.domain.study import Response, StudySpec
from tests.worker.optimizer.studies import space
from worker.optimizer.design import generator
from worker.optimizer.history import Design, History
from worker.optimizer.proposal import propose
from worker.optimizer.proposed import Proposal
from worker.optimizer.stopping import Stop, recommend

ANGLE = Response("angle_deg", 30.0, (28.5, 31.5), 0.5)
MASS = Response("mass_on_base_kg", 4.0, (3.7, 4.3), 0.15, 0.05)


def spec_of(*responses: Response, budget: int = 30) -> StudySpec:
    return StudySpec("test", 1.0, space(2), responses, budget=budget, parallel=1, seed=3)


def truth(x: tuple[float, ...]) -> dict[str, float]:
    """angle = 22 + 16 u_1 - 2 u_2, mass = 2 + 4 u_2: both targets at u_2 = .5, u_1 = .5625."""
    return {"angle_deg": 22.0 + 16.0 * x[0] - 2.0 * x[1], "mass_on_base_kg": 2.0 + 4.0 * x[1]}


def play(spec: StudySpec, noise: float = 1.0) -> tuple[History, Stop]:
    """Noise .3 deg and .03 kg, times `noise`."""
    designs: list[Design] = []
    while True:
        answer = propose(spec, History(tuple(designs)), len(designs) + 1)
        if isinstance(answer, Stop):
            return History(tuple(designs)), answer
        z = generator(answer.seed).standard_normal(2)
        found = truth(answer.x)
        results = {
            "angle_deg": found["angle_deg"] + 0.3 * noise * z[0],
            "mass_on_base_kg": found["mass_on_base_kg"] + 0.03 * noise * z[1],
        }
        known = {r.observable: results[r.observable] for r in spec.responses}
        designs.append(Design(len(designs) + 1, answer.x, answer.seed, known, answer.origin))


def test_a_study_of_two_responses_is_certified_on_both() -> None:
    spec = spec_of(ANGLE, MASS)
    history, stop = play(spec)
    assert stop.reason == "certified"
    best = recommend(spec, history)
    assert best is not None
    found = truth(best.x)
    assert found["angle_deg"] == pytest.approx(30.0, abs=0.7)
    assert found["mass_on_base_kg"] == pytest.approx(4.0, abs=0.2)
    assert [met.observable for met in best.responses] == ["angle_deg", "mass_on_base_kg"]
    assert all(
        met.expected_miss <= r.tolerance for met, r in zip(best.responses, spec.responses, strict=True)
    )
    assert best.window_probability >= 0.99
    record = best.as_record()
    assert record["mean_deg"] == best.responses[0].mean
    assert record["responses"]["mass_on_base_kg"]["unit"] == "kg"
    assert {"mean_deg", "mass_on_base_kg_mean_kg"} <= set(stop.numbers)


def test_one_good_response_is_no_certificate() -> None:
    """Eight seeds at a design whose angle is right and whose mass is not."""
    x = (0.5, 0.1)
    runs = tuple(
        Design(i, x, i, {"angle_deg": 30.0 + 0.01 * i, "mass_on_base_kg": 2.4}, "manual") for i in range(1, 9)
    )
    best = recommend(spec_of(ANGLE, MASS), History(runs))
    assert best is not None
    assert not best.certified
    alone = tuple(Design(d.number, x, d.seed, {"angle_deg": d.angle_deg or 0.0}, "manual") for d in runs)
    only = recommend(spec_of(ANGLE), History(alone))
    assert only is not None
    assert only.certified


def test_a_mass_that_no_design_reaches_is_said_in_kilograms() -> None:
    far = Response("mass_on_base_kg", 9.0, (8.5, 9.5), 0.2)
    _, stop = play(spec_of(ANGLE, far))
    assert stop.reason == "target_unreachable"
    assert stop.numbers["reachable_upper_kg"] == pytest.approx(6.0, abs=0.5)


def test_a_prediction_tells_of_every_response() -> None:
    history, _ = play(spec_of(ANGLE, MASS))
    answer = propose(spec_of(ANGLE, MASS), History(history.finished[:6]), 7)
    assert isinstance(answer, Proposal)
    assert answer.prediction is not None
    record = answer.prediction.as_record()
    assert set(record["responses"]) == {"angle_deg", "mass_on_base_kg"}
    assert "kg" in answer.reason

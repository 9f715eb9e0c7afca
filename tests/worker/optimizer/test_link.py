"""The AR(1) link where the truth is known, and what becomes of a test that misleads."""

from __future__ import annotations

import json

import numpy as np
import pytest

from service.domain.study import CoarsePrior
from tests.worker.optimizer.studies import at, space, spec_of
from worker.optimizer.design import FloatArray, sobol
from worker.optimizer.history import Design, History, WarmStudy
from worker.optimizer.link import Fit, Source, best_surrogate, linked, regress
from worker.optimizer.noise import NoiseEvidence
from worker.optimizer.outlook import build_outlook
from worker.optimizer.proposal import propose
from worker.optimizer.proposed import Proposal
from worker.optimizer.shared_designs import shared_designs
from worker.optimizer.surrogate import Surrogate, TrainingSet, fit_hyperparameters

QUIET = NoiseEvidence(4.0, 4.0 * 0.1**2)


def curve(u: FloatArray) -> FloatArray:
    return np.asarray(22.0 + 12.0 * np.sqrt(u[:, 0] + 0.01) + 4.0 * np.sin(4.0 * u[:, 1]))


def source(of: float = 1.0) -> Source:
    u = sobol(2, 32, 7)
    data = TrainingSet(u, of * curve(u), np.ones(32))
    return Source("coarse", Surrogate(data, fit_hyperparameters(data, QUIET)))


def some(count: int, seed: int = 3) -> FloatArray:
    return np.random.default_rng(seed).random((count, 2))


def test_rho_is_the_ridge_towards_one_by_hand() -> None:
    """m = -1, 1 and y = -2, 2 (slope 2); weights 1/(.1^2 + 1^2); prior N(1, .2^2)."""
    data = TrainingSet(some(2), np.array([-2.0, 2.0]), np.ones(2))
    weight = 1.0 / 1.01
    expected = (weight * 4.0 + 25.0) / (weight * 2.0 + 25.0)
    assert regress(data, np.array([-1.0, 1.0]), 0.1, 1.0) == pytest.approx(expected)


def test_two_shared_designs_carry_the_other_tests_shape_over() -> None:
    u, at_new = some(2), some(50, 4)
    truth = 1.1 * curve(u) + 3.0
    data = TrainingSet(u, truth, np.ones(2))
    found = linked(data, source(), QUIET, 1.0)
    alone = Surrogate(data, fit_hyperparameters(data, QUIET))
    expected = 1.1 * curve(at_new) + 3.0
    assert np.std(found.predict(at_new)[0] - expected) < 0.25 * np.std(alone.predict(at_new)[0] - expected)


def test_the_link_is_kept_where_it_predicts_better_and_dropped_where_it_misleads() -> None:
    u = some(8)
    helped = best_surrogate(TrainingSet(u, curve(u) + 2.0, np.ones(8)), [source()], QUIET, 1.0)
    assert helped.link is not None
    misled = best_surrogate(TrainingSet(u, 25.0 + 10.0 * u[:, 0], np.ones(8)), [source(-1.0)], QUIET, 1.0)
    assert misled.link is None


def designs(of: float, count: int, scale: float = 1.0, first: int = 1) -> tuple[Design, ...]:
    box = space(2, None)
    rows = sobol(2, count, 11)
    return tuple(
        Design(first + i, box.from_unit(u), i, at(float(of * curve(u[None])[0])), "doe", scale)
        for i, u in enumerate(rows)
    )


def test_coarse_runs_come_first_at_their_scale_and_cost_nothing() -> None:
    spec = spec_of(space(2), 30.0, coarse=CoarsePrior(2.0, 4), budget=3)
    done: list[Design] = []
    for number in range(1, 5):
        answer = propose(spec, History(coarse=tuple(done)), number)
        assert isinstance(answer, Proposal)
        assert (answer.origin, answer.scale) == ("coarse", 2.0)
        done.append(Design(number, answer.x, answer.seed, at(30.0 + answer.x[0]), "coarse", 2.0))
    first = propose(spec, History(coarse=tuple(done)), 5)
    assert isinstance(first, Proposal)
    assert (first.origin, first.scale) == ("doe", 1.0)
    assert first.x in {d.x for d in done}, "shared with the coarse runs"


def test_the_fidelities_are_never_pooled() -> None:
    """A coarse run at the very design says nothing of it but through the link."""
    spec = spec_of(space(2, None), 30.0)
    own = designs(1.0, 6)
    shifted = tuple(
        Design(100 + d.number, d.x, 1, at((d.angle_deg or 0.0) + 5.0), "coarse", 2.0) for d in own
    )
    outlook = build_outlook(spec, History(own, coarse=shifted))
    assert outlook.believe([d.x for d in own]).mean == pytest.approx([d.angle_deg for d in own], abs=0.5)
    assert all(g.runs == 1 for g in outlook.groups)


def test_the_second_shared_design_lies_apart_from_the_best() -> None:
    spec = spec_of(space(2, None), 30.0)
    coarse = designs(1.0, 16, 2.0)
    first, second = shared_designs(spec, History(coarse=coarse))[:2]
    by_x = {d.x: d.angle_deg or 0.0 for d in coarse}
    assert abs(by_x[first] - 30.0) == pytest.approx(min(abs(a - 30.0) for a in by_x.values()), abs=0.5)
    assert np.linalg.norm(np.subtract(first, second)) >= 0.15 * np.sqrt(2.0)


def test_a_linked_proposal_is_repeated_from_its_stored_fits() -> None:
    spec = spec_of(space(2, None), 30.0)
    history = History(designs(1.0, 3), warm=(WarmStudy(7, designs(1.05, 12)),))
    original = propose(spec, history, 4)
    assert isinstance(original, Proposal)
    assert original.hyperparameters is not None
    assert original.hyperparameters["angle_deg"]["link"]["source"] == "study 7"
    stored = json.loads(json.dumps(original.hyperparameters))
    fits = {name: Fit.from_dict(fit) for name, fit in stored.items()}
    assert propose(spec, history, 4, fits) == original

"""The noise evidence by hand."""

from __future__ import annotations

import math

import pytest

from service.domain.observables import ANGLE, NoiseLevel
from tests.worker.optimizer.studies import at
from worker.optimizer.history import Design, History
from worker.optimizer.noise import noise_evidence

A = (0.1, 0.2)
PAIR = History((Design(1, A, 1, at(30.0), "doe"), Design(2, A, 2, at(31.0), "replicate")))


def test_replicates_join_the_prior() -> None:
    """One pair 1 deg apart: SS = .5 with 1 degree of freedom; prior .25 with 2: (2 * .25 + .5) / 3 = 1/3."""
    found = noise_evidence(PAIR, ANGLE, 5.0)
    assert (found.freedom, found.squares) == (3.0, pytest.approx(1.0))
    assert found.sd == pytest.approx(math.sqrt(1.0 / 3.0))


def test_what_earlier_replicates_said_takes_the_priors_place() -> None:
    known = History(PAIR.finished, noise={"angle_deg": NoiseLevel(1.5, 12)})
    assert noise_evidence(known, ANGLE, 5.0).sd == pytest.approx(math.sqrt((12 * 1.5**2 + 0.5) / 13))
    long_known = History(noise={"angle_deg": NoiseLevel(1.5, 400)})
    assert noise_evidence(long_known, ANGLE, 5.0).freedom == 20.0


def test_a_response_without_a_prior_takes_a_tenth_of_its_spread() -> None:
    assert noise_evidence(History(), "mass_on_base_kg", 2.0).sd == pytest.approx(0.2)


def test_a_test_that_always_gives_the_same_number_keeps_a_little_noise() -> None:
    known = History(noise={"angle_deg": NoiseLevel(0.0, 10)})
    assert noise_evidence(known, ANGLE, 5.0).sd > 0.0

"""The same seed gives the same designs and the same recommendation, whatever dies and whoever is faster.

The optimizer is the real one; only the pile's angle is computed from a formula.
"""

from __future__ import annotations

import random
from typing import Any

import pytest
from sqlalchemy import select

from service.db.models import ProposalRow
from service.db.session import Database
from service.domain.outcome import PileMeasurement
from service.domain.states import StudyState
from service.domain.study import Response
from service.settings import Settings
from service.studies.claim_job import Claim
from service.studies.reap_job import reap_job
from tests.builders.studies import a_study, designs, event_kinds, let_lease_expire, study
from tests.builders.work import InProcessWorker, Report, synthetic_pile

COKE = {
    "material": "coke",
    "responses": (Response("angle_deg", 36.5, (35.0, 38.0), 0.5),),
    "budget": 10,
    "parallel": 3,
}


@pytest.fixture
def database(sqlite_database: Database) -> Database:
    """The optimizer is slow beside the database; which one it is does not matter here."""
    return sqlite_database


def outcome(database: Database, study_id: int) -> list[Any]:
    ended = study(database, study_id)
    assert ended.state is StudyState.COMPLETED
    rows = [
        (d.number, d.x, d.seed, d.origin, d.angle_deg, d.prediction, d.reason)
        for d in designs(database, study_id)
    ]
    with database.reading() as session:
        proposals = select(ProposalRow).where(ProposalRow.study_id == study_id).order_by(ProposalRow.number)
        told = [(p.number, p.basis, p.pending, p.training_hash) for p in session.scalars(proposals)]
    return [rows, told, ended.stop_reason, ended.stop_numbers, ended.recommendation]


def undisturbed(worker: InProcessWorker) -> list[Any]:
    study_id = a_study(worker.database, **COKE)
    worker.work_off()
    return outcome(worker.database, study_id)


def test_the_stop_of_a_spent_budget_has_seen_every_result(worker: InProcessWorker) -> None:
    narrow = (Response("angle_deg", 36.5, (36.4, 36.6), 0.25),)
    study_id = a_study(worker.database, **{**COKE, "responses": narrow, "budget": 6})
    worker.work_off()
    ended = study(worker.database, study_id)
    assert ended.stop_reason == "budget"
    assert ended.stop_numbers is not None
    assert ended.recommendation is not None
    assert ended.stop_numbers["mean_deg"] == ended.recommendation["mean_deg"]


class Vanished(BaseException):
    """As SIGKILL: nothing of the task's own code runs any more."""


def test_whatever_dies_and_whoever_is_faster(worker: InProcessWorker) -> None:
    expected = undisturbed(worker)
    assert len(expected[0]) > 6, "the study goes beyond its initial designs"
    chance = random.Random(5)
    killed = list[int]()

    def mortal(claim: Claim, report: Report, settings: Settings) -> PileMeasurement:
        if chance.random() < 0.4 and claim.lease.attempt < 3:
            killed.append(claim.design_number or 0)
            raise Vanished
        return synthetic_pile(claim, report, settings)

    worker.evaluate_by(mortal)
    study_id = a_study(worker.database, **COKE)
    while queued := worker.queued():
        job_id = chance.choice(queued)
        try:
            worker.perform(job_id)
        except Vanished:
            let_lease_expire(worker.database, job_id)
            with worker.database.writing() as session:
                from service.db import queries

                lease = queries.expired(session)[0]
                reap_job(session, lease)
    assert killed, "nothing was killed: the test shows nothing"
    assert "design_returned" in event_kinds(worker.database, study_id)
    assert outcome(worker.database, study_id) == expected


def test_another_seed_gives_other_designs(worker: InProcessWorker) -> None:
    first = a_study(worker.database, **{**COKE, "budget": 2, "initial_designs": 2})
    second = a_study(worker.database, **{**COKE, "budget": 2, "initial_designs": 2}, seed=2)
    worker.work_off()
    assert [d.x for d in designs(worker.database, first)] != [d.x for d in designs(worker.database, second)]


def test_a_study_ends_with_a_recommendation_from_all_its_designs(worker: InProcessWorker) -> None:
    study_id = a_study(worker.database, **COKE)
    worker.work_off()
    ended = study(worker.database, study_id)
    assert ended.recommendation is not None
    assert set(ended.recommendation) >= {
        "x",
        "mean_deg",
        "sd_deg",
        "expected_miss_deg",
        "window_probability",
        "replicates_deg",
        "certified",
        "half_width_90_deg",
    }
    assert set(ended.recommendation["x"]) == set(designs(worker.database, study_id)[0].x)
    count = ended.feasible + ended.unfeasible + ended.error
    assert count == len(designs(worker.database, study_id)) <= 10

"""The scatter between runs: pooled by hand, from the rows of a study, and where it is shown."""

from __future__ import annotations

import math

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import update

from service.db.models import DesignRow, StudyRow
from service.db.session import Database
from service.domain.noise import expected_of_sectors, pooled, run_noise, sum_of_squares
from service.domain.observables import NoiseLevel
from service.domain.states import JobKind
from service.domain.study import Response
from service.studies.read_history import read_history, read_whole_history
from service.studies.read_noise import read_noise
from tests.builders.studies import a_proposal, a_study, open_jobs, propose_next, simulate

ANGLE = Response("angle_deg", 25.5, (25.0, 26.0), 0.5)
MASS = Response("mass_on_base_kg", 12.0, (11.0, 13.0), 0.5)


def test_groups_are_pooled_by_their_degrees_of_freedom() -> None:
    """1, 3: SS 2; 0, 3, 6: SS 18; a single run says nothing. s^2 = 20 / 3."""
    groups = [(1.0, 3.0), (0.0, 3.0, 6.0), (9.0,)]
    assert sum_of_squares(groups) == (20.0, 3)
    assert pooled(groups) == NoiseLevel(math.sqrt(20.0 / 3.0), 3)
    assert pooled([(1.0,), ()]) is None


def test_earlier_replicates_of_the_test_count() -> None:
    """One degree of freedom with SS 2, three with a variance of 4: (2 + 12) / 4."""
    found = run_noise(ANGLE, [(1.0, 3.0)], NoiseLevel(2.0, 3))
    assert (found.sd, found.freedom) == (pytest.approx(math.sqrt(3.5)), 4)
    assert found.text == "1.9 deg measured (4 degrees of freedom)"


def test_without_replicates_it_is_what_is_expected_or_unknown() -> None:
    expected, unknown = run_noise(ANGLE, [(30.0,)]), run_noise(MASS, [(12.0,)])
    assert (expected.sd, expected.is_measured) == (0.5, False)
    assert expected.text == "0.5 deg expected, not yet measured"
    assert (unknown.sd, unknown.text) == (None, "not known before a design has run with two seeds")


def test_the_sectors_of_coarse_piles_let_expect_more() -> None:
    """1.8 times the median of 1.0, 1.2, 1.6; two piles tell nothing, and fine ones (.2) no more than any."""
    found = expected_of_sectors([1.6, None, 1.0, 1.2])
    assert found is not None
    assert (found.sd, found.freedom) == (pytest.approx(2.16), 3)
    told = run_noise(ANGLE, [(30.0,)], None, found)
    assert (told.sd, told.is_measured) == (pytest.approx(2.16), False)
    assert told.text == "2.2 deg expected from the sectors of the piles, not yet measured"
    assert run_noise(ANGLE, [(1.0, 3.0)], None, found).text == "1.4 deg measured (1 degree of freedom)"
    assert expected_of_sectors([1.6, None, 1.0]) is None
    assert expected_of_sectors([0.2, 0.2, 0.2]) is None


@pytest.mark.parametrize(("error", "sd"), [(1.2, 2.16), (0.1, 0.5)])
def test_what_sectors_tell_is_what_the_optimizer_expects_and_the_page_says(
    sqlite_database: Database, error: float, sd: float
) -> None:
    study_id = a_study(sqlite_database, parallel=3)
    for number in (1, 2, 3):
        propose_next(sqlite_database, study_id, a_proposal(number))
    for job in open_jobs(sqlite_database, study_id, JobKind.SIMULATE):
        simulate(sqlite_database, job, 25.0)
    with sqlite_database.writing() as session:
        session.execute(update(DesignRow).values(angle_sd_deg=error))
    with sqlite_database.reading() as session:
        row = session.get_one(StudyRow, study_id)
        told = read_whole_history(session, row).noise
        (shown,) = read_noise(session, row)
    assert {name: level.sd for name, level in told.items()} == pytest.approx(
        {} if sd == 0.5 else {"angle_deg": sd}
    )
    assert shown.sd == pytest.approx(sd)


def test_a_studys_replicates_are_pooled_and_shown(client: TestClient, sqlite_database: Database) -> None:
    """25 and 26 of one design, 30 of another, an error, and a coarse run of the first that is another test."""
    study_id = a_study(sqlite_database, parallel=5)
    first = a_proposal(1).x
    answers = [
        a_proposal(1),
        a_proposal(2, x=first),
        a_proposal(3),
        a_proposal(4, x=first),
        a_proposal(5, x=first, scale=4.0),
    ]
    for answer in answers:
        propose_next(sqlite_database, study_id, answer)
    jobs = open_jobs(sqlite_database, study_id)[:5]
    for job_id, angle in zip(jobs, (25.0, 26.0, 30.0, None, 99.0), strict=True):
        simulate(sqlite_database, job_id, angle)
    noise = client.get(f"/v1/studies/{study_id}").json()["noise"]
    assert [{k: v for k, v in one.items() if k != "sd"} for one in noise] == [
        {
            "observable": "angle_deg",
            "unit": "deg",
            "tolerance": 0.5,
            "freedom": 1,
            "is_measured": True,
            "text": "0.71 deg measured (1 degree of freedom)",
        }
    ]
    assert noise[0]["sd"] == pytest.approx(math.sqrt(0.5))
    assert client.get("/v1/studies").json()["items"][0]["noise"] is None
    page = client.get(f"/studies/{study_id}").text
    assert "0.71 deg measured (1 degree of freedom), beside a tolerance of 0.5°" in page


def test_a_row_of_before_responses_were_stored_is_left_out(sqlite_database: Database) -> None:
    study_id = a_study(sqlite_database, parallel=1)
    propose_next(sqlite_database, study_id)
    simulate(sqlite_database, open_jobs(sqlite_database, study_id)[0], 25.0)
    with sqlite_database.writing() as session:
        session.execute(update(DesignRow).values(responses=None))
        (noise,) = read_noise(session, session.get_one(StudyRow, study_id))
    assert noise.freedom == 0


def test_a_rough_pile_tells_of_its_scatter_before_a_seed_is_repeated(sqlite_database: Database) -> None:
    """1.8 times the median of the sectors' standard errors, where that is more than the usual .5 deg."""
    study_id = a_study(sqlite_database, parallel=1)
    for number, error in enumerate((0.9, 1.2, 3.0, 0.1), start=1):
        claim = propose_next(sqlite_database, study_id)
        assert claim.history is not None
        assert (dict(claim.history.noise) == {}) is (number <= 3)
        simulate(sqlite_database, open_jobs(sqlite_database, study_id, JobKind.SIMULATE)[0], 20.0 + number)
        with sqlite_database.writing() as session:
            latest = update(DesignRow).where(DesignRow.study_id == study_id, DesignRow.number == number)
            session.execute(latest.values(angle_sd_deg=error))
    history = propose_next(sqlite_database, study_id).history
    assert history is not None
    level = history.noise["angle_deg"]
    assert (level.sd, level.freedom) == (pytest.approx(1.8 * 1.05), 3)
    with sqlite_database.writing() as session:
        session.execute(update(DesignRow).values(angle_sd_deg=0.2))
        study = session.get_one(StudyRow, study_id)
        assert read_history(session, study).noise == {}

"""The course of a study: what is proposed when, on what basis, and how it ends."""

from __future__ import annotations

from sqlalchemy import event

from service.db import read_models
from service.db.session import Database
from service.domain.history import StudyStop
from service.domain.states import DesignState, JobKind, StudyState, Verdict
from service.studies.cancel_job import cancel_job
from service.studies.record_recommendation import record_recommendation
from tests.builders.studies import (
    a_study,
    add_finished_designs,
    claimed,
    designs,
    event_kinds,
    open_jobs,
    propose_next,
    simulate,
    study,
)


def test_as_many_designs_are_in_flight_as_the_study_says(database: Database) -> None:
    study_id = a_study(database, parallel=3)
    for _ in range(3):
        propose_next(database, study_id)
    assert open_jobs(database, study_id, JobKind.PROPOSE) == []
    assert len(open_jobs(database, study_id, JobKind.SIMULATE)) == 3


def test_a_proposal_sees_the_same_whoever_finishes_first(database: Database) -> None:
    """parallel = 2: design 4 is based on designs 1 and 2, though 3 is finished as well."""
    study_id = a_study(database, parallel=2)
    propose_next(database, study_id)
    propose_next(database, study_id)
    first, second = open_jobs(database, study_id, JobKind.SIMULATE)
    simulate(database, second, 30.0)
    assert open_jobs(database, study_id, JobKind.PROPOSE) == [], "design 3 waits for design 1"
    simulate(database, first, None)
    claim = propose_next(database, study_id)
    assert claim.history is not None
    assert [(d.number, d.angle_deg) for d in claim.history.finished] == [(1, None)]
    assert [p.number for p in claim.history.pending] == [2], "finished, but not to be looked at yet"
    # Design 2 is over too, so design 4 is due at once, while 3 runs.
    claim = propose_next(database, study_id)
    assert claim.history is not None
    assert [(d.number, d.angle_deg) for d in claim.history.finished] == [(1, None), (2, 30.0)]
    assert [p.number for p in claim.history.pending] == [3]


def test_cancelled_designs_are_seen_by_no_proposal_and_hold_nothing_up(database: Database) -> None:
    study_id = a_study(database, parallel=1)
    propose_next(database, study_id)
    (job_id,) = open_jobs(database, study_id, JobKind.SIMULATE)
    with database.writing() as session:
        cancel_job(session, job_id)
    claim = propose_next(database, study_id)
    assert claim.history is not None
    assert claim.history.number == 2
    assert claim.history.finished == ()
    assert claim.history.pending == ()


def test_a_stop_lets_what_is_in_flight_finish_and_then_asks_for_the_recommendation(
    database: Database,
) -> None:
    study_id = a_study(database, parallel=2)
    propose_next(database, study_id)
    propose_next(database, study_id)
    first, second = open_jobs(database, study_id, JobKind.SIMULATE)
    simulate(database, first, 25.5)
    propose_next(database, study_id, StudyStop("budget", "All is spent.", {"budget": 2.0}))
    assert study(database, study_id).state is StudyState.FINISHING
    assert open_jobs(database, study_id) == [second]
    simulate(database, second, 40.0)
    (job_id,) = open_jobs(database, study_id)
    claim = claimed(database, job_id)
    assert claim.kind is JobKind.RECOMMEND
    assert claim.history is not None
    assert [d.number for d in claim.history.finished] == [1, 2]
    assert claim.history.pending == ()
    with database.writing() as session:
        assert record_recommendation(session, claim.lease, {"x": {"rolling_resistance": 0.2}})
    ended = study(database, study_id)
    assert ended.state is StudyState.COMPLETED
    assert (ended.stop_reason, ended.stop_numbers) == ("budget", {"budget": 2.0})
    assert ended.recommendation == {"x": {"rolling_resistance": 0.2}}
    assert (ended.feasible, ended.unfeasible, ended.error) == (1, 1, 0)
    assert ended.ended_at is not None
    assert event_kinds(database, study_id) == [
        "study_created",
        "design_proposed",
        "design_proposed",
        "design_started",
        "design_finished",
        "study_stopping",
        "design_started",
        "design_finished",
        "study_finished",
    ]


def test_the_window_decides_the_verdict_its_ends_included(database: Database) -> None:
    study_id = a_study(database, parallel=4)
    for _ in range(4):
        propose_next(database, study_id)
    jobs = open_jobs(database, study_id, JobKind.SIMULATE)
    for job_id, angle in zip(jobs, (25.0, 26.0, 26.001, None), strict=True):
        simulate(database, job_id, angle)
    found = [(d.state, d.verdict) for d in designs(database, study_id)]
    assert found == [
        (DesignState.COMPLETE, Verdict.FEASIBLE),
        (DesignState.COMPLETE, Verdict.FEASIBLE),
        (DesignState.COMPLETE, Verdict.UNFEASIBLE),
        (DesignState.FAILED, Verdict.ERROR),
    ]


def test_a_study_of_200_designs_opens_in_three_statements(database: Database) -> None:
    study_id = a_study(database, budget=200)
    add_finished_designs(database, study_id, 200)
    statements = list[str]()
    event.listen(database.engine, "before_cursor_execute", lambda *args: statements.append(args[2]))
    with database.reading() as session:
        page = read_models.open_study(session, study_id)
    selects = [text for text in statements if text.startswith("SELECT")]
    assert len(selects) <= 3
    assert page is not None
    assert [view.design.number for view in page.designs] == list(range(1, 201))
    assert all(view.job is not None and len(view.artifacts) == 1 for view in page.designs)
    assert page.best is not None
    assert page.best.design.angle_deg == 25.5

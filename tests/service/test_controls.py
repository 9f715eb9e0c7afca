"""What a user does to a study while it runs, with workers in flight: nothing is lost, nothing counted twice."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import BudgetChangeRow, ProposalRow
from service.db.session import Database
from service.domain.errors import InvalidValue
from service.domain.history import StudyHistory, StudyStop
from service.domain.states import (
    ActionNotAllowed,
    ChangeNotAllowed,
    DesignState,
    JobKind,
    JobState,
    StudyState,
)
from service.studies.add_design import add_design, rerun_design
from service.studies.cancel_study import cancel_study
from service.studies.claim_job import claim_job
from service.studies.extend_budget import extend_budget
from service.studies.pause_study import pause_study
from service.studies.record_measurement import record_measurement
from service.studies.record_proposal import record_proposal
from service.studies.resume_study import resume_study
from tests.builders.studies import (
    a_finished_study,
    a_measurement,
    a_proposal,
    a_study,
    claimed,
    designs,
    event_kinds,
    job,
    open_jobs,
    propose_next,
    simulate,
    study,
)

X = {
    "particle_particle_static_friction": 0.5,
    "particle_wall_static_friction": 0.4,
    "particle_particle_restitution": 0.3,
    "rolling_resistance": 0.2,
}
FAILURES = StudyStop(
    "too_many_failures", "3 of 5 simulations ended in error.", {"failed": 3.0, "finished": 5.0}
)


def do(database: Database, action: Callable[[Session], object]) -> None:
    with database.writing() as session:
        assert action(session) is not None


def pause(database: Database, study_id: int) -> None:
    do(database, lambda session: pause_study(session, study_id))


def resume(database: Database, study_id: int) -> None:
    do(database, lambda session: resume_study(session, study_id))


def extend(database: Database, study_id: int, budget: int) -> None:
    do(database, lambda session: extend_budget(session, study_id, budget))


def add(
    database: Database, study_id: int, seed: int | None = None, key: str | None = None, **x: float
) -> int:
    """The number of the added design."""
    with database.writing() as session:
        design = add_design(session, study_id, {**X, **x}, seed, key)
        assert design is not None
        return design.number


def seen(history: StudyHistory | None) -> tuple[list[int], list[int]]:
    assert history is not None
    return [d.number for d in history.finished], [p.number for p in history.pending]


def to_publish(database: Database) -> list[str]:
    with database.reading() as session:
        return [job_id for job_id, _ in queries.to_publish(session)]


def test_a_paused_study_starts_nothing_and_lets_what_runs_finish(database: Database) -> None:
    study_id = a_study(database, parallel=2)
    propose_next(database, study_id)
    propose_next(database, study_id)
    running, queued = open_jobs(database, study_id)
    lease = claimed(database, running).lease
    pause(database, study_id)
    pause(database, study_id)
    assert study(database, study_id).pause_reason == "user"
    assert to_publish(database) == []
    with database.writing() as session:
        assert claim_job(session, queued, "w", 10.0) is None, "a message that was out already finds it held"
    with database.writing() as session:
        assert record_measurement(session, lease, a_measurement(25.5))
    assert open_jobs(database, study_id) == [queued]
    assert job(database, queued).state is JobState.QUEUED
    resume(database, study_id)
    resume(database, study_id)
    proposal, *_ = open_jobs(database, study_id, JobKind.PROPOSE)
    assert set(to_publish(database)) == {queued, proposal}
    assert event_kinds(database, study_id).count("study_paused") == 1
    assert event_kinds(database, study_id).count("study_resumed") == 1


def test_a_proposal_that_was_under_way_when_its_study_paused_is_discarded(database: Database) -> None:
    study_id = a_study(database)
    (job_id,) = open_jobs(database, study_id)
    claim = claimed(database, job_id)
    pause(database, study_id)
    with database.writing() as session:
        assert queries.beat(session, claim.lease, 10.0, None) is None, "its worker is fenced off"
    resume(database, study_id)
    with database.writing() as session:
        assert not record_proposal(session, claim.lease, a_proposal(1))
    assert designs(database, study_id) == []
    again = propose_next(database, study_id)
    assert again.history == claim.history
    assert [d.number for d in designs(database, study_id)] == [1]


def test_failures_pause_a_study_and_are_forgiven_when_it_is_resumed(database: Database) -> None:
    study_id = a_study(database, parallel=1)
    for _ in range(5):
        propose_next(database, study_id)
        simulate(database, open_jobs(database, study_id)[0], None)
    propose_next(database, study_id, FAILURES)
    row = study(database, study_id)
    assert (row.state, row.pause_reason, row.pause_text) == (
        StudyState.PAUSED,
        "too_many_failures",
        "3 of 5 simulations ended in error.",
    )
    assert row.pause_numbers == {"failed": 3.0, "finished": 5.0}
    assert (row.stop_reason, row.ended_at, open_jobs(database, study_id)) == (None, None, [])
    resume(database, study_id)
    claim = propose_next(database, study_id)
    assert claim.history is not None
    assert claim.history.accepted == 5
    assert study(database, study_id).pause_reason is None


def test_a_users_own_pause_forgives_nothing(database: Database) -> None:
    study_id = a_study(database, parallel=1)
    propose_next(database, study_id)
    simulate(database, open_jobs(database, study_id)[0], None)
    pause(database, study_id)
    resume(database, study_id)
    assert study(database, study_id).failures_forgiven == 0


def test_only_a_running_study_is_paused_and_only_a_paused_one_resumed(database: Database) -> None:
    study_id = a_finished_study(database)
    with (
        database.writing() as session,
        pytest.raises(ChangeNotAllowed, match="completed cannot become paused"),
    ):
        pause_study(session, study_id)
    with database.writing() as session, pytest.raises(ActionNotAllowed, match="study 1 is completed"):
        resume_study(session, study_id)
    with database.writing() as session:
        assert pause_study(session, 99) is None
        assert resume_study(session, 99) is None
        assert extend_budget(session, 99, 50) is None
        assert add_design(session, 99, X) is None
        assert rerun_design(session, 99, same_seed=False) is None


def test_a_paused_study_can_be_cancelled(database: Database) -> None:
    study_id = a_study(database)
    propose_next(database, study_id)
    pause(database, study_id)
    do(database, lambda session: cancel_study(session, study_id))
    (last,) = open_jobs(database, study_id)
    assert job(database, last).kind is JobKind.RECOMMEND
    assert designs(database, study_id)[0].state is DesignState.CANCELLED
    assert to_publish(database) == [last]


def test_more_budget_fences_off_the_proposal_that_did_not_know_of_it(database: Database) -> None:
    study_id = a_study(database, budget=12, parallel=1)
    (job_id,) = open_jobs(database, study_id)
    stale = claimed(database, job_id)
    extend(database, study_id, 20)
    extend(database, study_id, 20)
    with database.writing() as session:
        assert not record_proposal(session, stale.lease, StudyStop("budget", "All is spent.", {}))
    claim = propose_next(database, study_id)
    assert claim.spec.budget == 20
    assert study(database, study_id).budget == 20
    with database.reading() as session:
        changes = [(c.number, c.before, c.after) for c in session.scalars(select(BudgetChangeRow))]
    assert changes == [(1, 12, 20)]


def test_a_study_that_ends_for_want_of_budget_goes_on_with_more(database: Database) -> None:
    study_id = a_study(database, budget=3, parallel=1)
    propose_next(database, study_id)
    simulate(database, open_jobs(database, study_id)[0], 30.0)
    propose_next(database, study_id, StudyStop("budget", "All is spent.", {"budget": 3.0}))
    (recommendation,) = open_jobs(database, study_id)
    lease = claimed(database, recommendation).lease
    extend(database, study_id, 6)
    row = study(database, study_id)
    assert (row.state, row.stop_reason) == (StudyState.RUNNING, None)
    with database.reading() as session:
        assert queries.is_job_over(session, lease.job_id)
    assert seen(propose_next(database, study_id).history) == ([1], [])


@pytest.mark.parametrize(
    ("budget", "error", "told"),
    [
        (5, InvalidValue, "more than the present 12"),
        (0, InvalidValue, "more than the present 12"),
        (1001, InvalidValue, "1 to 1000"),
    ],
)
def test_a_budget_only_grows(database: Database, budget: int, error: type[Exception], told: str) -> None:
    study_id = a_study(database, budget=12)
    with pytest.raises(error, match=told), database.writing() as session:
        extend_budget(session, study_id, budget)
    assert study(database, study_id).budget == 12


def test_a_study_that_is_over_gets_no_more_budget_and_no_designs(database: Database) -> None:
    study_id = a_finished_study(database)
    with database.writing() as session:
        with pytest.raises(ActionNotAllowed, match="is completed"):
            extend_budget(session, study_id, 50)
        with pytest.raises(ActionNotAllowed, match="takes no more designs"):
            add_design(session, study_id, X)


def test_a_design_by_hand_takes_the_next_number_and_the_open_proposal_comes_after_it(
    database: Database,
) -> None:
    """parallel = 2: design 3 is by hand; the proposal that was made for 3 is discarded, 4 sees designs 1 and 2."""
    study_id = a_study(database, parallel=2)
    propose_next(database, study_id)
    propose_next(database, study_id)
    first, second = open_jobs(database, study_id)
    simulate(database, first, 30.0)
    (job_id,) = open_jobs(database, study_id, JobKind.PROPOSE)
    stale = claimed(database, job_id)
    assert stale.history is not None
    assert stale.history.number == 3
    assert add(database, study_id) == 3
    with database.writing() as session:
        assert not record_proposal(session, stale.lease, a_proposal(3))
    assert open_jobs(database, study_id, JobKind.PROPOSE) == [], "design 4 waits for design 2"
    simulate(database, second, 31.0)
    claim = propose_next(database, study_id)
    assert seen(claim.history) == ([1, 2], [3])
    rows = designs(database, study_id)
    assert [(d.number, d.origin) for d in rows] == [(1, "doe"), (2, "doe"), (3, "manual"), (4, "doe")]
    with database.reading() as session:
        told = session.execute(
            select(ProposalRow.number, ProposalRow.chosen, ProposalRow.basis, ProposalRow.pending)
        ).all()
    assert [tuple(row) for row in told] == [(1, 1, 0, 0), (2, 2, 0, 1), (4, 4, 2, 1)]


def test_adding_a_design_twice(database: Database) -> None:
    study_id = a_study(database)
    assert add(database, study_id, key="k") == 1
    assert add(database, study_id, key="k") == 1
    assert add(database, study_id, seed=7) == 2
    assert add(database, study_id, seed=7) == 2
    assert add(database, study_id) == 3, "without key or seed it is another replicate"
    rows = designs(database, study_id)
    assert len({row.seed for row in rows}) == 3
    assert len({row.x_hash for row in rows}) == 1
    with pytest.raises(InvalidValue, match="belongs to design 1"):
        add(database, study_id, key="k", rolling_resistance=0.3)


def test_a_seed_by_hand_depends_on_the_study_alone(database: Database) -> None:
    seeds = []
    for _ in range(2):
        study_id = a_study(database, seed=5)
        add(database, study_id)
        add(database, study_id)
        seeds.append([row.seed for row in designs(database, study_id)])
    assert seeds[0] == seeds[1]


@pytest.mark.parametrize(
    ("x", "seed", "field"),
    [
        ({"rolling_resistance": 0.7}, None, "x.rolling_resistance"),
        ({"rolling_resistance": float("nan")}, None, "x.rolling_resistance"),
        ({"mu": 0.5}, None, "x.mu"),
        ({}, -1, "seed"),
        ({}, 2**31, "seed"),
    ],
)
def test_a_design_outside_the_study_is_refused(
    sqlite_database: Database, x: dict[str, float], seed: int | None, field: str
) -> None:
    study_id = a_study(sqlite_database)
    with pytest.raises(InvalidValue) as refused:
        add(sqlite_database, study_id, seed, **x)
    assert refused.value.field == field
    with pytest.raises(InvalidValue) as refused, sqlite_database.writing() as session:
        add_design(session, study_id, {"rolling_resistance": 0.2})
    assert refused.value.field == "x.particle_particle_static_friction"
    assert designs(sqlite_database, study_id) == []


def test_a_design_by_hand_counts_against_the_budget(database: Database) -> None:
    study_id = a_study(database, budget=2, initial_designs=2)
    add(database, study_id)
    add(database, study_id)
    with pytest.raises(ActionNotAllowed, match="extend it first"):
        add(database, study_id)
    extend(database, study_id, 3)
    assert add(database, study_id) == 3


def test_a_design_that_is_added_while_the_study_is_paused_waits(database: Database) -> None:
    study_id = a_study(database)
    pause(database, study_id)
    add(database, study_id)
    assert to_publish(database) == []
    resume(database, study_id)
    assert len(to_publish(database)) == 2, "its simulation, and the next proposal"


def test_another_seed_of_a_design(database: Database) -> None:
    study_id = a_study(database, parallel=1)
    propose_next(database, study_id)
    first = designs(database, study_id)[0]
    with database.writing() as session:
        again = rerun_design(session, first.id, same_seed=False)
        assert again is not None
        assert (again.number, again.origin, again.x, again.supersedes) == (2, "replicate", first.x, None)
        assert again.seed != first.seed


def test_an_error_that_is_repeated_is_forgotten_once_the_repetition_is_seen(database: Database) -> None:
    study_id = a_study(database, parallel=1)
    propose_next(database, study_id)
    simulate(database, open_jobs(database, study_id, JobKind.SIMULATE)[0], None)
    failed = designs(database, study_id)[0]
    with database.writing() as session:
        again = rerun_design(session, failed.id, same_seed=True)
        assert again is not None
        assert (again.number, again.seed, again.supersedes) == (2, failed.seed, 1)
    with database.writing() as session:
        twice = rerun_design(session, failed.id, same_seed=True)
        assert twice is not None
        assert twice.id == again.id
    simulate(database, open_jobs(database, study_id, JobKind.SIMULATE)[0], None)
    with database.writing() as session:
        third = rerun_design(session, failed.id, same_seed=True)
        assert third is not None
        assert third.number == 3
    simulate(database, open_jobs(database, study_id, JobKind.SIMULATE)[0], 25.5)
    claim = propose_next(database, study_id)
    assert seen(claim.history) == ([3], [])
    assert claim.history is not None
    assert claim.history.finished[0].results is not None
    row = study(database, study_id)
    assert (row.feasible, row.error) == (1, 2), "all three were simulated"


def test_the_same_seed_only_after_an_error(database: Database) -> None:
    study_id = a_study(database, parallel=1)
    propose_next(database, study_id)
    simulate(database, open_jobs(database, study_id)[0], 25.5)
    design = designs(database, study_id)[0]
    with pytest.raises(ActionNotAllowed, match="design 1 is COMPLETE"), database.writing() as session:
        rerun_design(session, design.id, same_seed=True)

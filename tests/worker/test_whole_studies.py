"""Every strategy from its request to its end through the use cases; only the pile's angle is a formula.

Where the formula crashes, which verdict an angle has and what counts against a budget is said here once more,
independently of the service.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest
from sqlalchemy import select

from demcore.errors import NoResult
from service.db.models import DesignRow, ProposalRow, ReportRow, StudyRow
from service.db.session import Database
from service.domain.outcome import PileMeasurement
from service.domain.search_space import SearchSpace, Variable
from service.domain.states import JobKind, StudyState
from service.domain.study import CoarsePrior, Response, TableRow
from service.settings import Settings
from service.studies.add_design import rerun_design
from service.studies.claim_job import Claim
from service.studies.export_study import export_study
from service.studies.import_study import import_study
from service.studies.read_noise import read_noise
from service.studies.request_report import request_report
from service.studies.study_file import StudyFile, content_hash
from tests.builders.studies import (
    a_measurement,
    a_proposal,
    a_study,
    designs,
    event_kinds,
    open_jobs,
    propose_next,
    simulate,
    study,
)
from tests.builders.work import InProcessWorker, Report
from worker.optimize import whole_history
from worker.optimizer.proposal import place_of

PP, ROLL = "particle_particle_static_friction", "rolling_resistance"
SPACE = SearchSpace((Variable(PP, 0.1, 0.9, 0.01), Variable(ROLL, 0.05, 0.6, 0.01)))
WINDOW = (29.0, 33.0)
SINTER: dict[str, Any] = {
    "material": "sinter",
    "space": SPACE,
    "responses": (Response("angle_deg", 31.0, WINDOW, 0.5),),
    "initial_designs": 5,
    "parallel": 2,
    "budget": 9,
}


def pile(claim: Claim, _report: Report, _settings: Settings) -> PileMeasurement:
    """A plane with a small scatter; 1.5 deg more at the coarse scale, no pile in the corner of low values."""
    pp, roll = claim.x
    if pp + roll < 0.35:
        raise NoResult("nothing lies on the base")
    shift = 1.5 if claim.scale > claim.spec.scale else 0.0
    scatter = 0.1 * (claim.seed % 7 - 3) / 3.0
    return a_measurement(22.0 + 10.0 * pp + 12.0 * roll + shift + scatter)


@pytest.fixture
def database(sqlite_database: Database) -> Database:
    return sqlite_database


@pytest.fixture
def at_work(worker: InProcessWorker) -> InProcessWorker:
    worker.evaluate_by(pile)
    return worker


def played(worker: InProcessWorker, **changes: Any) -> tuple[StudyRow, list[DesignRow]]:
    """A whole study, and what holds for every one that ends: state, counters, recommendation, report."""
    study_id = a_study(worker.database, **{**SINTER, **changes})
    worker.work_off()
    row, found = study(worker.database, study_id), designs(worker.database, study_id)
    assert row.state is StudyState.COMPLETED
    assert [d.number for d in found] == list(range(1, len(found) + 1))
    told = Counter(_verdict(d) for d in found if d.origin != "import")
    assert (row.feasible, row.unfeasible, row.error) == tuple(
        told[v] for v in ("feasible", "unfeasible", "error")
    )
    at_scale = [d for d in found if d.scale == row.spec["scale"] and d.origin != "import"]
    assert len(at_scale) <= row.budget
    assert row.recommendation is not None
    assert row.recommendation["x"] in [d.x for d in found if d.angle_deg is not None]
    assert row.stop_reason != "certified" or row.recommendation["certified"] is True
    with worker.database.reading() as session:
        report = session.scalars(select(ReportRow).where(ReportRow.study_id == study_id)).one()
    assert report.content["enough"] is True
    return row, found


def _verdict(design: DesignRow) -> str:
    if design.angle_deg is None:
        return "error"
    return "feasible" if WINDOW[0] <= design.angle_deg <= WINDOW[1] else "unfeasible"


@pytest.mark.parametrize(
    "strategy",
    # Nine runs: three levels by three, and the array L9.
    ["sobol", "latin_hypercube", "factorial", "taguchi"],
)
def test_a_plain_design_runs_whole_and_says_what_came_out(at_work: InProcessWorker, strategy: str) -> None:
    row, found = played(at_work, strategy=strategy, budget=9)
    assert row.stop_reason == "design_complete"
    assert len(found) == 9
    assert {d.origin for d in found} == {"doe"}
    assert row.stop_numbers is not None
    assert [row.stop_numbers[v] for v in ("feasible", "unfeasible", "error")] == [
        row.feasible,
        row.unfeasible,
        row.error,
    ]


def test_a_plan_shorter_than_its_budget_tells_of_all_its_runs(at_work: InProcessWorker) -> None:
    """Nine of eleven runs; the stop was decided while the last one was still out."""
    row, found = played(at_work, strategy="taguchi", budget=11)
    assert (row.stop_reason, len(found)) == ("design_complete", 9)
    assert row.stop_numbers is not None
    assert sum(row.stop_numbers[v] for v in ("feasible", "unfeasible", "error")) == 9
    assert row.recommendation is not None
    assert row.stop_numbers["mean_deg"] == row.recommendation["mean_deg"]


def test_a_coarse_run_that_is_repeated_uses_a_number_and_no_budget(database: Database) -> None:
    study_id = a_study(database, parallel=1, coarse=CoarsePrior(4.0, 8))
    propose_next(database, study_id, a_proposal(1, origin="coarse", scale=4.0))
    simulate(database, open_jobs(database, study_id, JobKind.SIMULATE)[0], None)
    with database.writing() as session:
        assert rerun_design(session, designs(database, study_id)[0].id, same_seed=True) is not None
    simulate(database, open_jobs(database, study_id, JobKind.SIMULATE)[0], 25.5)
    claim = propose_next(database, study_id)
    assert claim.history is not None
    history = whole_history(claim.history)
    assert [d.number for d in history.coarse] == [2]
    place = place_of(claim.history.spec, history, claim.history.number)
    assert place == (3, 1, claim.history.spec.budget)


def test_a_table_runs_in_its_order_and_knows_what_it_knew(at_work: InProcessWorker) -> None:
    """Two rows have results, three are run; the budget is theirs alone."""
    xs = [(0.3, 0.2), (0.5, 0.3), (0.7, 0.4), (0.2, 0.1), (0.8, 0.1)]
    results = [None, {"angle_deg": 30.6}, None, None, {"angle_deg": 31.2}]
    table = tuple(
        TableRow(dict(zip(SPACE.names, x, strict=True)), r) for x, r in zip(xs, results, strict=True)
    )
    row, found = played(at_work, strategy="table", table=table, budget=3)
    assert [(d.origin, tuple(d.x.values())) for d in found] == [
        ("import", xs[1]),
        ("import", xs[4]),
        ("doe", xs[0]),
        ("doe", xs[2]),
        ("doe", xs[3]),
    ]
    assert (row.stop_reason, row.feasible + row.unfeasible, row.error) == ("design_complete", 2, 1)
    assert row.stop_numbers is not None
    assert row.stop_numbers["error"] == 1.0
    with at_work.database.reading() as session:
        proposals = select(ProposalRow).where(ProposalRow.study_id == row.id).order_by(ProposalRow.number)
        pending = [p.pending for p in session.scalars(proposals)]
    # Known rows are never pending; of those in flight the second and third proposal do not see one.
    assert pending == [0, 1, 1, 0]


def test_a_table_without_results_is_all_simulated(at_work: InProcessWorker) -> None:
    table = tuple(TableRow({PP: pp, ROLL: 0.3}) for pp in (0.2, 0.5, 0.5, 0.8))
    row, found = played(at_work, strategy="table", table=table, budget=4)
    assert (len(found), row.stop_reason) == (4, "design_complete")
    assert len({d.seed for d in found if d.x[PP] == 0.5}) == 2, "the same row twice is two seeds"


def test_a_known_table_helps_auto_and_costs_nothing(at_work: InProcessWorker) -> None:
    known = tuple(
        TableRow({PP: pp, ROLL: roll}, {"angle_deg": 22.0 + 10.0 * pp + 12.0 * roll})
        for pp in (0.3, 0.6, 0.9)
        for roll in (0.1, 0.3, 0.6)
    )
    row, found = played(at_work, table=known)
    assert row.stop_reason == "certified"
    assert [d.origin for d in found[:9]] == ["import"] * 9
    assert len(found) - 9 <= row.budget


def test_improve_surrogate_spends_its_budget(at_work: InProcessWorker) -> None:
    row, found = played(at_work, strategy="improve_surrogate")
    assert (row.stop_reason, len(found)) == ("design_complete", 9)
    assert Counter(d.origin for d in found)["model"] >= 3


def test_a_certificate_that_the_last_pile_takes_back_is_not_given(at_work: InProcessWorker) -> None:
    asked: dict[str, Any] = {"budget": 16, "parallel": 3}
    row, found = played(at_work, **asked)
    assert row.stop_reason == "certified"
    with at_work.database.reading() as session:
        stop = session.scalars(select(ProposalRow).where(ProposalRow.stop_reason == "certified")).one()
    last = found[-1]
    assert stop.basis < last.number, "the stop did not wait for its last piles"

    def slumped(claim: Claim, report: Report, settings: Settings) -> PileMeasurement:
        """The last pile of the winner slid."""
        if (claim.x, claim.seed) == (tuple(last.x.values()), last.seed):
            return a_measurement(20.0)
        return pile(claim, report, settings)

    at_work.evaluate_by(slumped)
    row, more = played(at_work, **asked)
    assert [d.x for d in more[: len(found)]] == [d.x for d in found]
    assert len(more) > len(found)
    kinds = event_kinds(at_work.database, row.id)
    assert kinds.count("study_goes_on") == kinds.count("study_stopping") - 1 >= 1
    with at_work.database.reading() as session:
        proposals = select(ProposalRow).where(
            ProposalRow.study_id == row.id, ProposalRow.number == stop.number
        )
        told = [(p.basis, p.stop_reason) for p in session.scalars(proposals.order_by(ProposalRow.id))]
    assert told == [(stop.basis, "certified"), (stop.number - 1, None)]


def test_auto_with_coarse_runs_first(at_work: InProcessWorker) -> None:
    row, found = played(at_work, coarse=CoarsePrior(4.0, 6))
    assert row.stop_reason == "certified"
    assert row.recommendation is not None and row.recommendation["certified"] is True
    assert [(d.origin, d.scale) for d in found[:6]] == [("coarse", 4.0)] * 6
    assert all(d.scale == 2.0 and d.origin != "coarse" for d in found[6:])
    coarse = [d.x for d in found[:6]]
    assert [d.x in coarse for d in found[6:8]] == [True, True], "shared designs measure the difference"


def test_auto_starts_from_a_stored_study(at_work: InProcessWorker) -> None:
    source, _ = played(at_work, strategy="sobol", budget=12)
    row, found = played(at_work, warm_start=(source.id,))
    assert row.stop_reason == "certified"
    _, alone = played(at_work)
    assert len(found) <= len(alone)
    with at_work.database.reading() as session:
        (noise,) = read_noise(session, row)
    assert noise.is_measured


def test_coarse_runs_that_all_crash_pause_the_study(at_work: InProcessWorker) -> None:
    def crash(*_: object) -> PileMeasurement:
        raise NoResult("nothing lies on the base")

    at_work.evaluate_by(crash)
    study_id = a_study(at_work.database, **{**SINTER, "coarse": CoarsePrior(4.0, 20), "parallel": 1})
    at_work.work_off()
    row = study(at_work.database, study_id)
    assert (row.state, row.pause_reason, row.error) == (StudyState.PAUSED, "too_many_failures", 5)


def test_a_read_in_study_does_not_start_from_whatever_has_that_number_here(at_work: InProcessWorker) -> None:
    """Its warm start names studies of the place where it ran; its known rows are no simulations."""
    source, _ = played(at_work, strategy="sobol", budget=6)
    known = (TableRow({PP: 0.3, ROLL: 0.2}, {"angle_deg": 27.4}),)
    row, _ = played(at_work, warm_start=(source.id,), table=known, budget=4)
    with at_work.database.writing() as session:
        file = export_study(session, row.id, "0.1.0")
        assert file is not None
        file["study"]["spec"]["warm_start"] = [999]
        signed = {**file, "content_sha256": content_hash(file["study"])}
        copy, _ = import_study(session, StudyFile.model_validate(signed))
        assert (copy.feasible, copy.unfeasible, copy.error) == (row.feasible, row.unfeasible, row.error)
        copy_id = copy.id
        request_report(session, copy_id)
    at_work.work_off()
    with at_work.database.reading() as session:
        of_copy = select(ReportRow).where(ReportRow.study_id == copy_id)
        reports = session.scalars(of_copy).all()
    assert len(reports) == 2, "the file's own, and the one that was asked for here"
    assert reports[-1].content["enough"] is True

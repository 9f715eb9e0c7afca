"""Studies and jobs for tests, with defaults for whatever a test does not care about."""

from __future__ import annotations

import math
from typing import Any

from sqlalchemy import select, update

from service.db.clock import lease_now
from service.db.models import ArtifactRow, DesignRow, EventRow, JobRow, StudyRow
from service.db.session import Database
from service.domain.history import ProposedDesign, StudyStop
from service.domain.outcome import Failure, FailureClass, PileMeasurement, RunCost, StoredArtifact
from service.domain.search_space import default_space
from service.domain.states import DesignState, JobKind, JobState, Verdict
from service.domain.study import Response, StudySpec
from service.studies.cancel_job import cancel_job
from service.studies.claim_job import Claim, claim_job
from service.studies.create_study import create_study
from service.studies.record_failure import record_failure
from service.studies.record_measurement import record_measurement
from service.studies.record_proposal import record_proposal
from service.studies.record_recommendation import record_recommendation
from service.studies.record_report import record_report

LEASE_S = 10.0


def a_spec(**changes: Any) -> StudySpec:
    defaults: dict[str, Any] = {
        "material": "pellet",
        "scale": 2.0,
        "space": default_space(),
        "responses": (Response("angle_deg", 25.5, (25.0, 26.0), 0.5),),
        "budget": 12,
    }
    return StudySpec(**{**defaults, **changes})


def a_study(database: Database, **changes: Any) -> int:
    """The id of a new study, with its propose job queued."""
    with database.writing() as session:
        return create_study(session, a_spec(**changes))[0].id


def a_proposal(number: int, **changes: Any) -> ProposedDesign:
    """Another x for each number."""
    defaults: dict[str, Any] = {
        "x": (round(0.1 + 0.01 * number, 2), 0.5, 0.3, 0.2),
        "seed": number,
        "origin": "doe",
        "reason": "spread over the box",
        "scale": 2.0,
        "training_hash": "0" * 64,
    }
    return ProposedDesign(**{**defaults, **changes})


def a_measurement(angle_deg: float = 25.4, artifacts: tuple[StoredArtifact, ...] = ()) -> PileMeasurement:
    return PileMeasurement(angle_deg, 0.2, angle_deg - 8.0, {"mass_on_base_kg": 12.5}, artifacts)


def open_jobs(database: Database, study_id: int, kind: JobKind | None = None) -> list[str]:
    """Ids of queued and running jobs, oldest first."""
    with database.reading() as session:
        found = select(JobRow.id).where(
            JobRow.study_id == study_id, JobRow.state.in_((JobState.QUEUED, JobState.RUNNING))
        )
        if kind is not None:
            found = found.where(JobRow.kind == kind)
        return list(session.scalars(found.order_by(JobRow.created_at)))


def claimed(database: Database, job_id: str, worker: str = "worker-a", lease_s: float = LEASE_S) -> Claim:
    with database.writing() as session:
        claim = claim_job(session, job_id, worker, lease_s)
    assert claim is not None
    return claim


def propose_next(
    database: Database, study_id: int, answer: ProposedDesign | StudyStop | None = None
) -> Claim:
    """Do the study's propose job as a worker would; the claim shows what the optimizer was told."""
    (job_id,) = open_jobs(database, study_id, JobKind.PROPOSE)
    claim = claimed(database, job_id)
    assert claim.history is not None
    with database.writing() as session:
        assert record_proposal(session, claim.lease, answer or a_proposal(claim.history.number))
    return claim


def a_simulate_job(database: Database, **changes: Any) -> tuple[int, str]:
    """A study with one queued simulate job; their ids."""
    study_id = a_study(database, **changes)
    propose_next(database, study_id)
    (job_id,) = open_jobs(database, study_id, JobKind.SIMULATE)
    return study_id, job_id


def simulate(database: Database, job_id: str, angle_deg: float | None, cost: RunCost | None = None) -> None:
    """Do a simulate job as a worker would; None: it ends in error."""
    lease = claimed(database, job_id).lease
    with database.writing() as session:
        if angle_deg is None:
            assert record_failure(session, lease, Failure(FailureClass.NO_RESULT, "no pile"), cost)
        else:
            assert record_measurement(session, lease, a_measurement(angle_deg), cost)


A_REPORT: dict[str, Any] = {
    "version": 1,
    "enough": True,
    "designs": {"finished": 3, "failed": 1, "with_results": 2},
    "posterior": {
        "parameters": [
            {
                "name": name,
                "mean": 0.4,
                "sd": 0.1,
                "lower_90": 0.2,
                "upper_90": 0.6,
                "sd_ratio": ratio,
                "label": label,
            }
            for name, ratio, label in (
                ("rolling_resistance", 0.2, "identified"),
                ("particle_particle_static_friction", 0.6, "weak"),
                ("particle_wall_static_friction", 0.98, "not identified"),
            )
        ],
        "text": [
            "rolling_resistance is identified.",
            "Identified only as a combination: friction + rolling.",
        ],
        "draws": {"names": [], "x": [], "means": []},
    },
    "which_test_next": [{"text": "Mass on the base: the spread of friction is expected to shrink to 40 %."}],
    "ensemble": {
        "members": [
            {"x": {"rolling_resistance": n / 10}, "window_probability": 0.9, "weight": 0.2} for n in range(5)
        ],
        "level": 0.5,
        "text": "as far apart as can be",
    },
}


def write_report(database: Database, study_id: int, content: dict[str, Any] | None = None) -> None:
    """Do the study's report job as a worker would."""
    (job_id,) = open_jobs(database, study_id, JobKind.REPORT)
    claim = claimed(database, job_id)
    assert claim.history is not None
    finished = len(claim.history.finished)
    with database.writing() as session:
        assert record_report(session, claim.lease, finished, content or A_REPORT, RunCost("0123456789abcdef"))


def a_finished_study(database: Database, **changes: Any) -> int:
    """A certified study of four designs: in the window, outside it, an error, cancelled."""
    study_id = a_study(database, **{"parallel": 4, **changes})
    fit = {"noise_sd_deg": 0.5, "length_scales": [0.4, 1.0, 2.0, 0.3]}
    told = {"mean_deg": 25.5, "sd_deg": 0.4}
    for number in (1, 2, 3, 4):
        more = {"hyperparameters": fit, "prediction": told} if number > 2 else {}
        propose_next(database, study_id, a_proposal(number, training_hash=f"{number:064x}", **more))
    cost = RunCost("0123456789abcdef", 1e-4, 20_000, 12.5, 12.25, 210.0)
    jobs = open_jobs(database, study_id, JobKind.SIMULATE)
    for job_id, angle in zip(jobs, (25.4, 30.0, None), strict=False):
        simulate(database, job_id, angle, cost)
    with database.writing() as session:
        cancel_job(session, jobs[3])
    propose_next(database, study_id, StudyStop("certified", "Within 0.5 deg (90 %).", {"sd_deg": 0.2}))
    (last,) = open_jobs(database, study_id)
    lease = claimed(database, last).lease
    with database.writing() as session:
        assert record_recommendation(session, lease, {"x": {"rolling_resistance": 0.2}, "mean_deg": 25.4})
    write_report(database, study_id)
    return study_id


def let_lease_expire(database: Database, job_id: str) -> None:
    """As if the worker, where the job has one, had been silent for its whole lease."""
    held = (JobRow.id == job_id, JobRow.state == JobState.RUNNING)
    with database.writing() as session:
        session.execute(update(JobRow).where(*held).values(lease_until=lease_now() - 0.001))


def job(database: Database, job_id: str) -> JobRow:
    with database.reading() as session:
        return session.get_one(JobRow, job_id)


def study(database: Database, study_id: int) -> StudyRow:
    with database.reading() as session:
        return session.get_one(StudyRow, study_id)


def designs(database: Database, study_id: int) -> list[DesignRow]:
    with database.reading() as session:
        found = select(DesignRow).where(DesignRow.study_id == study_id).order_by(DesignRow.number)
        return list(session.scalars(found))


def event_kinds(database: Database, study_id: int) -> list[str]:
    with database.reading() as session:
        found = select(EventRow.kind).where(EventRow.study_id == study_id).order_by(EventRow.id)
        return list(session.scalars(found))


def add_finished_designs(database: Database, study_id: int, count: int) -> None:
    """Rows as `count` finished designs leave them, angles from 25 degrees upwards; not through the use cases,
    which take a second for a hundred."""
    names = default_space().names
    with database.writing() as session:
        for n in range(1, count + 1):
            design = DesignRow(
                study_id=study_id,
                number=n,
                x=dict.fromkeys(names, n / count),
                x_hash=f"{n:064x}",
                scale=2.0,
                seed=n,
                origin="doe",
                reason="spread over the box",
                state=DesignState.COMPLETE,
                verdict=Verdict.FEASIBLE,
                angle_deg=25.0 + (n - 1) / 100,
                responses={"angle_deg": 25.0 + (n - 1) / 100},
            )
            session.add(design)
            session.flush()
            job_id = f"{study_id:08d}-0000-4000-8000-{n:012d}"
            done = JobRow(
                id=job_id,
                kind=JobKind.SIMULATE,
                study_id=study_id,
                design_id=design.id,
                state=JobState.DONE,
                max_attempts=3,
            )
            picture = ArtifactRow(
                design_id=design.id,
                kind="picture",
                file_name="pile.png",
                media_type="image/png",
                sha256="ab" * 32,
                size_bytes=10,
                path="ab/" + "ab" * 32,
            )
            session.add_all([done, picture])


def synthetic_angle(spec: StudySpec, x: tuple[float, ...], seed: int) -> float:
    """calibration.md's synthetic repose angle, with a scatter that depends on x and the seed alone."""
    p = spec.space.as_dict(x)
    pp, r = p["particle_particle_static_friction"], p["rolling_resistance"]
    pw, e = p["particle_wall_static_friction"], p["particle_particle_restitution"]

    def saturates(a: float) -> float:
        return 1.0 - math.exp(-a)

    angle = 14.5 + 9.0 * saturates(pp / 0.2) + 18.0 * saturates(r / 0.25) * saturates(pp / 0.3)
    angle += 1.5 * saturates(pw / 0.3) - 3.0 * (e - 0.1) / 0.5 * math.exp(-r / 0.3)
    return angle + 0.3 * math.sin(1000.0 * sum(x) + 77.0 * seed)

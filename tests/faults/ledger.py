"""What was accepted, and what became of it: nothing lost, nothing done twice, the same bits as undisturbed."""

from __future__ import annotations

import hashlib
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import httpx
from sqlalchemy import select
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session

from service.db.models import ArtifactRow, DesignRow, EventRow, JobRow, RunRow, StudyRow
from service.domain.states import JobState, StudyState, Verdict, is_over
from tests.faults.rig import Rig

# A client gives up its request only after this long.
CLIENT_PATIENCE_S = 120.0
# From the end of the last fault to the end of all work.
SETTLING_S = 240.0
VARIANTS = (11, 23)


def a_request(variant: int) -> dict[str, Any]:
    """A real study of the smallest piles that still have an angle: 77 particles, a second each."""
    return {
        "material": "pellet",
        "scale": 4.0,
        "fill_level": 0.3,
        "strategy": "sobol",
        "budget": 2,
        "parallel": 2,
        "seed": variant,
        "variables": {
            "particle_particle_static_friction": {"lower": 0.3, "upper": 0.7},
            "rolling_resistance": {"lower": 0.2, "upper": 0.5},
        },
    }


@dataclass
class Accepted:
    """Requests that the API said yes to, by idempotency key, with their variant and the answered ids."""

    variants: dict[str, int] = field(default_factory=dict)
    ids: dict[str, set[int]] = field(default_factory=dict)
    refusals: Counter[int] = field(default_factory=Counter)
    problems: list[str] = field(default_factory=list)

    def send(self, rig: Rig, key: str, variant: int) -> None:
        """As a patient client: again with the same key until there is a yes; then once more."""
        deadline = time.monotonic() + CLIENT_PATIENCE_S
        wanted = 2
        while wanted and time.monotonic() < deadline:
            try:
                answer = httpx.post(
                    f"{rig.settings.base_url}/v1/studies",
                    json=a_request(variant),
                    headers={"Idempotency-Key": key},
                    timeout=20.0,
                )
            except httpx.TransportError:
                time.sleep(0.2)
                continue
            if answer.status_code == 201:
                self.variants[key] = variant
                self.ids.setdefault(key, set()).add(int(answer.json()["id"]))
                wanted -= 1
                continue
            self.refusals[answer.status_code] += 1
            is_problem = answer.headers["content-type"] == "application/problem+json"
            if answer.status_code != 503 or not is_problem or "retry-after" not in answer.headers:
                self.problems.append(f"POST answered {answer.status_code}: {answer.text[:200]}")
                return
            time.sleep(0.2)
        if wanted:
            self.problems.append(f"POST {key}: no yes within {CLIENT_PATIENCE_S:g} s")


def send_all(rig: Rig, accepted: Accepted, requests: list[tuple[float, str, int]]) -> list[threading.Thread]:
    """Each request (seconds from now, key, variant) by a client of its own."""

    def client(delay: float, key: str, variant: int) -> None:
        time.sleep(delay)
        accepted.send(rig, key, variant)

    clients = [threading.Thread(target=client, args=request, daemon=True) for request in requests]
    for one in clients:
        one.start()
    return clients


def is_settled(rig: Rig, keys: list[str]) -> bool:
    """All studies of `keys` are over, their jobs too."""
    try:
        with rig.database.reading() as session:
            studies = session.scalars(select(StudyRow).where(StudyRow.idempotency_key.in_(keys))).all()
            ids = [study.id for study in studies]
            states = session.scalars(select(JobRow.state).where(JobRow.study_id.in_(ids))).all()
    except DBAPIError:
        return False
    paused = [study for study in studies if study.state is StudyState.PAUSED]
    assert not paused, f"a study was paused: {paused[0].pause_text}"
    return (
        len(studies) == len(keys)
        and all(is_over(study.state) for study in studies)
        and all(map(is_over, states))
    )


def fingerprint(session: Session, study: StudyRow) -> str:
    """A hash of everything that a study computed: parameters, results to the last bit, contents of files."""
    designs = session.scalars(
        select(DesignRow).where(DesignRow.study_id == study.id).order_by(DesignRow.number)
    ).all()
    found: list[Any] = [study.recommendation, study.stop_reason]
    for design in designs:
        files = select(ArtifactRow.kind, ArtifactRow.sha256).where(ArtifactRow.design_id == design.id)
        found.append(
            (
                *(design.number, design.x, design.seed, design.verdict, design.angle_deg),
                # What a clock said is the one thing that may differ.
                {name: value for name, value in (design.results or {}).items() if name != "wall_s"},
                design.failure_text,
                sorted(map(tuple, session.execute(files))),
            )
        )
    return hashlib.sha256(repr(found).encode()).hexdigest()


@dataclass
class Counts:
    """Jobs, by what became of them."""

    accepted: int = 0
    finished_once: int = 0
    lost: int = 0
    doubled: int = 0
    attempts: int = 0
    bits_equal: bool = True


@dataclass
class Audit(Counts):
    """What an audit found."""

    problems: list[str] = field(default_factory=list)


def audit(rig: Rig, accepted: Accepted, references: dict[int, str]) -> Audit:
    """Every accepted study with all its jobs, row by row. `references`: fingerprints of undisturbed runs."""
    found = Audit(problems=list(accepted.problems))
    with rig.database.reading() as session:
        for key, variant in accepted.variants.items():
            studies = session.scalars(select(StudyRow).where(StudyRow.idempotency_key == key)).all()
            if len(studies) != 1 or accepted.ids[key] != {studies[0].id}:
                found.problems.append(f"{key} is {len(studies)} studies, answered as {accepted.ids[key]}")
                found.lost += not studies
                found.doubled += len(studies) > 1
                continue
            _audit_jobs(session, studies[0], found)
            _audit_study(rig, session, studies[0], found)
            expected = references.get(variant)
            if expected is not None and fingerprint(session, studies[0]) != expected:
                found.bits_equal = False
                found.problems.append(
                    f"study {studies[0].id} (variant {variant}) has other bits than undisturbed"
                )
    return found


def _audit_jobs(session: Session, study: StudyRow, found: Audit) -> None:
    for job in session.scalars(select(JobRow).where(JobRow.study_id == study.id)):
        runs = session.scalars(select(RunRow).where(RunRow.job_id == job.id)).all()
        done = [run for run in runs if run.exit_class == "done"]
        found.accepted += 1
        found.attempts += len(runs)
        found.doubled += len(done) > 1
        is_once = job.state is JobState.DONE and len(done) == 1 and done[0].attempt == job.attempt
        found.finished_once += is_once
        if not is_once:
            found.lost += len(done) == 0
            history = [(run.attempt, run.exit_class, run.exit_text) for run in runs]
            found.problems.append(f"job {job.id} ({job.kind.value}) is {job.state.value}: {history}")


def _audit_study(rig: Rig, session: Session, study: StudyRow, found: Audit) -> None:
    designs = session.scalars(select(DesignRow).where(DesignRow.study_id == study.id)).all()
    events = session.execute(select(EventRow.kind, EventRow.data).where(EventRow.study_id == study.id)).all()
    finished = Counter(data["number"] for kind, data in events if kind == "design_finished")
    told = Counter(kind for kind, _ in events)
    verdicts = Counter(design.verdict for design in designs)
    counters = {
        Verdict.FEASIBLE: study.feasible,
        Verdict.UNFEASIBLE: study.unfeasible,
        Verdict.ERROR: study.error,
    }
    for is_so, what in (
        (study.state is StudyState.COMPLETED, f"is {study.state.value}: {study.stop_text}"),
        (len(designs) == study.budget, f"has {len(designs)} designs of {study.budget}"),
        (all(finished[design.number] == 1 for design in designs), f"told of ends {dict(finished)}"),
        (told["study_finished"] == 1, f"told of its end {told['study_finished']} times"),
        (all(verdicts[v] == n for v, n in counters.items()), f"counts {counters} of {dict(verdicts)}"),
    ):
        if not is_so:
            found.doubled += "told" in what or "counts" in what
            found.problems.append(f"study {study.id} {what}")
    for design in designs:
        for file in session.scalars(select(ArtifactRow).where(ArtifactRow.design_id == design.id)):
            content = (rig.settings.artifacts_dir / file.path).read_bytes()
            if hashlib.sha256(content).hexdigest() != file.sha256:
                found.problems.append(f"artifact {file.id} is not what was stored")

"""`make outages`: the broker away for a minute, the database away for ten seconds, under real jobs.

The figures are those that service.md promises: every POST is taken while the broker is away, what ran goes on, and
the backlog is published within seconds of its return; while the database is away every answer is 503 with
Retry-After; nothing is lost, doubled or changed by either.
"""

from __future__ import annotations

import argparse
import sqlite3
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import httpx
from sqlalchemy import func, select

from service.db.models import JobRow
from service.domain.states import JobState
from tests.faults.campaign import make_references
from tests.faults.ledger import SETTLING_S, VARIANTS, Accepted, a_request, audit, is_settled
from tests.faults.rig import Rig, running_rig

BROKER_AWAY_S, DATABASE_AWAY_S = 60.0, 10.0
DRAINED_WITHIN_S = 5.0
# What a client waits for one answer at most; the slowest is reported.
PATIENCE_S = 60.0
POST_EVERY_S, ASK_EVERY_S = 3.0, 0.5


@dataclass
class Outage:
    """One outage: `answers` of POST and GET by status while it lasted, and what followed."""

    what: str
    lasted_s: float
    answers: Counter[int] = field(default_factory=Counter)
    slowest_answer_s: float = 0.0
    ended_meanwhile: int = 0
    drained_after_s: float | None = None
    jobs: int = 0
    finished_once: int = 0
    problems: list[str] = field(default_factory=list)

    def line(self) -> str:
        drained = "" if self.drained_after_s is None else f"; backlog out after {self.drained_after_s:.1f} s"
        meanwhile = f"; {self.ended_meanwhile} jobs ended meanwhile" if self.ended_meanwhile else ""
        return (
            f"{self.what} away for {self.lasted_s:.0f} s: answers {dict(self.answers)}, slowest "
            f"{self.slowest_answer_s:.2f} s{meanwhile}{drained}; "
            f"{self.finished_once} of {self.jobs} jobs finished once"
            + "".join(f"\n  WRONG: {problem}" for problem in self.problems)
        )


def broker_away(rig: Rig, references: dict[int, str], seconds: float = BROKER_AWAY_S) -> Outage:
    """kill -9 of the broker, and nobody starts it for so long."""
    found, accepted = Outage("broker", seconds), Accepted()
    with busy(rig, accepted):
        rig.processes["broker"].kill()
        running = _running(rig)
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            _post(rig, found, accepted, 201)
            time.sleep(POST_EVERY_S)
        found.ended_meanwhile = _done(rig, running)
        rig.processes["broker"].start()
        back = time.monotonic()
        rig.wait_for(lambda: _unpublished(rig) == 0, SETTLING_S, "the backlog is published")
        found.drained_after_s = time.monotonic() - back
    if not found.ended_meanwhile == len(running) > 0:
        found.problems.append(f"{found.ended_meanwhile} of {len(running)} running jobs came to their end")
    if found.drained_after_s > DRAINED_WITHIN_S:
        found.problems.append(f"the backlog waited for more than {DRAINED_WITHIN_S:g} s")
    return _settled(rig, found, accepted, references)


def database_away(rig: Rig, references: dict[int, str], seconds: float = DATABASE_AWAY_S) -> Outage:
    """PostgreSQL is killed and stays down for so long; an SQLite file is locked by another program."""
    found, accepted = Outage("database", seconds), Accepted()
    with busy(rig, accepted):
        with _no_database(rig) as is_readable:
            until = time.monotonic() + seconds
            while time.monotonic() < until:
                _post(rig, found, Accepted(), 503)
                _get(rig, found, 200 if is_readable else 503)
                time.sleep(ASK_EVERY_S)
        back = time.monotonic()
        rig.wait_for(lambda: _takes_work(rig, accepted), SETTLING_S, "a request is taken again")
        found.drained_after_s = time.monotonic() - back
    return _settled(rig, found, accepted, references)


@contextmanager
def busy(rig: Rig, accepted: Accepted) -> Iterator[None]:
    """Studies enough to keep both workers busy, of which at least one job runs now."""
    for variant in VARIANTS * 2:
        accepted.send(rig, f"before-{variant}-{time.time_ns()}", variant)
    rig.wait_for(lambda: bool(_running(rig)), SETTLING_S, "a job that runs")
    yield


@contextmanager
def _no_database(rig: Rig) -> Iterator[bool]:
    """Whether reads still work meanwhile: those of an SQLite file whose write lock another program holds do."""
    if rig.postgres is not None:
        rig.postgres.kill()
        try:
            yield False
        finally:
            rig.postgres.start_again()
        return
    other = sqlite3.connect(rig.data / "talus.db", isolation_level=None, timeout=60.0)
    other.execute("BEGIN IMMEDIATE")
    try:
        yield True
    finally:
        other.execute("ROLLBACK")
        other.close()


def _post(rig: Rig, found: Outage, accepted: Accepted, expected: int) -> None:
    key = f"meanwhile-{time.time_ns()}"
    variant = VARIANTS[sum(found.answers.values()) % len(VARIANTS)]
    answer = _asked(found, lambda: _send(rig, key, variant), expected)
    if answer is not None:
        _note(accepted, key, variant, answer)


def _get(rig: Rig, found: Outage, expected: int) -> None:
    url = f"{rig.settings.base_url}/v1/studies?limit=5"
    _asked(found, lambda: httpx.get(url, timeout=PATIENCE_S), expected)


def _asked(found: Outage, ask: Callable[[], httpx.Response], expected: int) -> httpx.Response | None:
    """The answer, counted; a wrong one is a problem of the outage."""
    started = time.monotonic()
    try:
        answer = ask()
    except httpx.TransportError as error:
        found.problems.append(f"no answer: {error!r}")
        return None
    found.slowest_answer_s = max(found.slowest_answer_s, time.monotonic() - started)
    found.answers[answer.status_code] += 1
    if answer.status_code != expected:
        found.problems.append(f"answered {answer.status_code}, not {expected}: {answer.text[:150]}")
    elif expected == 503 and (
        answer.headers["content-type"] != "application/problem+json" or "retry-after" not in answer.headers
    ):
        found.problems.append(f"a 503 without problem+json or Retry-After: {dict(answer.headers)}")
    return answer


def _takes_work(rig: Rig, accepted: Accepted) -> bool:
    key = f"after-{time.time_ns()}"
    return _note(accepted, key, VARIANTS[0], _send(rig, key, VARIANTS[0]))


def _send(rig: Rig, key: str, variant: int) -> httpx.Response:
    url, headers = f"{rig.settings.base_url}/v1/studies", {"Idempotency-Key": key}
    return httpx.post(url, json=a_request(variant), headers=headers, timeout=PATIENCE_S)


def _note(accepted: Accepted, key: str, variant: int, answer: httpx.Response) -> bool:
    """Whether it is a yes; then the audit will ask for it."""
    if answer.status_code == 201:
        accepted.variants[key], accepted.ids[key] = variant, {int(answer.json()["id"])}
    return answer.status_code == 201


def _settled(rig: Rig, found: Outage, accepted: Accepted, references: dict[int, str]) -> Outage:
    keys = list(accepted.variants)
    rig.wait_for(lambda: is_settled(rig, keys), SETTLING_S, "the end of all work")
    seen = audit(rig, accepted, references)
    found.jobs, found.finished_once = seen.accepted, seen.finished_once
    found.problems += seen.problems
    if not seen.bits_equal:
        found.problems.append("other bits than undisturbed")
    return found


def _running(rig: Rig) -> list[str]:
    with rig.database.reading() as session:
        return list(session.scalars(select(JobRow.id).where(JobRow.state == JobState.RUNNING)))


def _done(rig: Rig, job_ids: list[str]) -> int:
    """How many of them came to their end, in the attempt that they were in."""
    ended = select(func.count()).select_from(JobRow).where(JobRow.id.in_(job_ids), JobRow.attempt == 1)
    with rig.database.reading() as session:
        return session.scalar(ended.where(JobRow.state == JobState.DONE)) or 0


def _unpublished(rig: Rig) -> int:
    waiting = select(func.count()).select_from(JobRow)
    waiting = waiting.where(JobRow.state == JobState.QUEUED, JobRow.published_at.is_(None))
    with rig.database.reading() as session:
        return session.scalar(waiting) or 0


def measure_outages(backend: str, broker_s: float, database_s: float) -> list[Outage]:
    """Both outages on one installation."""
    with running_rig(backend, lease_s=10.0) as rig:
        references = make_references(rig)
        found = [broker_away(rig, references, broker_s)]
        rig.wait_until_well()
        found.append(database_away(rig, references, database_s))
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--broker", type=float, default=BROKER_AWAY_S, help="seconds")
    parser.add_argument("--database", type=float, default=DATABASE_AWAY_S, help="seconds")
    wanted = parser.parse_args()
    outages = list[Outage]()
    for backend in ("sqlite", "postgresql"):
        for outage in measure_outages(backend, wanted.broker, wanted.database):
            print(f"{backend}: {outage.line()}", flush=True)
            outages.append(outage)
    return 1 if any(outage.problems for outage in outages) else 0


if __name__ == "__main__":
    sys.exit(main())

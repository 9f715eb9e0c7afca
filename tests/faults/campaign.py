"""Schedule after schedule on running installations, and the sum of what they showed."""

from __future__ import annotations

import random
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

from sqlalchemy import select

from service.db.models import RunRow, StudyRow
from tests.faults.faults import WINDOW_S, Injected, Injection, Kill, draw_schedule, inject, left_out
from tests.faults.ledger import (
    SETTLING_S,
    VARIANTS,
    Accepted,
    Audit,
    Counts,
    audit,
    fingerprint,
    is_settled,
    send_all,
)
from tests.faults.rig import Rig, running_rig

Say = Callable[[str], None]


@dataclass
class Total(Counts):
    """The sum over schedules."""

    schedules: int = 0
    noticed_s: list[float] = field(default_factory=list)
    again_s: list[float] = field(default_factory=list)
    # Commands that run the schedules that failed again.
    failed: list[str] = field(default_factory=list)

    def add(self, found: Audit) -> None:
        self.schedules += 1
        self._count(found)

    def fail(self, command: str) -> None:
        if command not in self.failed:
            self.failed.append(command)

    def join(self, other: Total) -> None:
        """What another campaign found, too."""
        self.schedules += other.schedules
        self._count(other)
        for name in ("noticed_s", "again_s", "failed"):
            getattr(self, name).extend(getattr(other, name))

    def _count(self, found: Counts) -> None:
        for name in ("accepted", "finished_once", "lost", "doubled", "attempts"):
            setattr(self, name, getattr(self, name) + getattr(found, name))
        self.bits_equal &= found.bits_equal

    def lines(self, lease_s: float) -> list[str]:
        good = self.schedules - len(self.failed)
        return [
            f"{good} of {self.schedules} schedules; jobs accepted {self.accepted}, finished once "
            f"{self.finished_once}, lost {self.lost}, doubled {self.doubled}, attempts {self.attempts}; "
            f"bits equal: {'yes' if self.bits_equal else 'NO'}",
            f"a killed worker's job, lease {lease_s:g} s: taken away {_times(self.noticed_s)}; "
            f"at work again {_times(self.again_s)}",
            *(f"replay: {command}" for command in self.failed),
        ]


def _times(seconds: list[float]) -> str:
    if not seconds:
        return "never"
    return (
        f"after {statistics.median(seconds):.1f} s (median of {len(seconds)}), {max(seconds):.1f} s (worst)"
    )


def make_references(rig: Rig) -> dict[int, str]:
    """Each variant once, undisturbed, on this very installation."""
    accepted = Accepted()
    requests = [(0.0, f"reference-{variant}-{time.time_ns()}", variant) for variant in VARIANTS]
    for client in send_all(rig, accepted, requests):
        client.join()
    keys = [key for _, key, _ in requests]
    rig.wait_for(lambda: is_settled(rig, keys), SETTLING_S, "the undisturbed studies")
    found = audit(rig, accepted, {})
    assert not found.problems, found.problems
    with rig.database.reading() as session:
        return {
            variant: fingerprint(
                session, session.scalars(select(StudyRow).where(StudyRow.idempotency_key == key)).one()
            )
            for _, key, variant in requests
        }


def run_schedule(
    rig: Rig, seed: int, references: dict[int, str], total: Total, say: Say, window_s: float = WINDOW_S
) -> list[str]:
    """One schedule by its seed: requests, faults, healing, audit; what was wrong."""
    rng = random.Random(seed)
    schedule = draw_schedule(rng, rig, window_s)
    requests = [
        (rng.uniform(0.0, window_s / 2), f"{seed}-{n}-{time.time_ns()}", rng.choice(VARIANTS))
        for n in range(rng.randint(1, 2))
    ]
    accepted, injected = Accepted(), Injected(rig, rng)
    started = time.monotonic()
    clients = send_all(rig, accepted, requests)
    try:
        inject(schedule, injected)
    finally:
        rig.heal()
    for client in clients:
        client.join()
    keys = list(accepted.variants)
    problems = list[str]()
    try:
        rig.wait_for(lambda: is_settled(rig, keys), SETTLING_S, "the end of all work")
    except AssertionError as error:
        problems.append(str(error))
    found = audit(rig, accepted, references)
    problems.extend(found.problems)
    total.add(found)
    _time_takeovers(rig, injected.kills, total)
    if problems:
        total.fail(replay_command(rig, seed, window_s))
    outcome = "FAILED" if problems else "well"
    refused = f", {sum(accepted.refusals.values())} times refused" if accepted.refusals else ""
    say(
        f"{rig.backend} seed {seed}: {outcome} in {time.monotonic() - started:.0f} s; {found.finished_once} of "
        f"{found.accepted} jobs in {found.attempts} attempts{refused}; {told(schedule)}"
    )
    return problems


def replay_command(rig: Rig, seed: int, window_s: float) -> str:
    """What draws the same schedule again: a seed means another one on the other database, or over another time."""
    lease = f"{rig.settings.lease_seconds:g}"
    return f"make faults SCHEDULES=1 SEED={seed} BACKEND={rig.backend} LEASE={lease} WINDOW={window_s:g}"


def told(schedule: list[Injection]) -> str:
    return "; ".join(map(str, schedule))


def _time_takeovers(rig: Rig, kills: list[Kill], total: Total) -> None:
    """How long after a worker's death its job was taken away from it, and was at work again."""
    with rig.database.reading() as session:
        for kill in kills:
            # Its earlier attempts may have been lost to something else, a machine that stalls for a lease.
            lost = select(RunRow).where(
                RunRow.worker_id.in_(kill.worker_ids),
                RunRow.exit_class == "lost",
                RunRow.ended_at > kill.when,
            )
            for run in session.scalars(lost):
                assert run.ended_at is not None
                total.noticed_s.append(run.ended_at - kill.when)
                later = select(RunRow.started_at).where(
                    RunRow.job_id == run.job_id, RunRow.attempt == run.attempt + 1
                )
                total.again_s.extend(when - kill.when for when in session.scalars(later))


def run_campaign(rig: Rig, seeds: list[int], total: Total, say: Say, window_s: float = WINDOW_S) -> list[str]:
    """All schedules; after each the installation is well again before the next. `seeds` loses each that began."""
    for name, reason in left_out(rig).items():
        say(f"{rig.backend}: skipped: {name} ({reason})")
    references = make_references(rig)
    problems = list[str]()
    while seeds:
        seed = seeds.pop(0)
        problems += [
            f"{rig.backend} seed {seed}: {text}"
            for text in run_schedule(rig, seed, references, total, say, window_s)
        ]
        try:
            rig.wait_until_well()
        except AssertionError as error:
            # A process that ended by itself is a failure of this schedule, not the end of the others.
            problems.append(f"{rig.backend} seed {seed}: afterwards {error}")
            total.fail(replay_command(rig, seed, window_s))
            break
    return problems


def run_everywhere(
    seeds: Mapping[str, Sequence[int]], say: Say, lease_s: float, window_s: float = WINDOW_S
) -> tuple[Total, list[str]]:
    """The schedules of each database (sqlite, postgresql): the sum, and what was wrong.

    The databases run at once, since most of a schedule is waiting, for a lease or for a process that starts.
    """

    def run_one(backend: str) -> tuple[Total, list[str]]:
        total, problems, left = Total(), list[str](), list(seeds[backend])
        while left:
            with running_rig(backend, lease_s=lease_s) as rig:
                problems += run_campaign(rig, left, total, say, window_s)
        return total, problems

    total, problems = Total(), list[str]()
    with ThreadPoolExecutor(max(1, len(seeds))) as pool:
        for found, wrong in pool.map(run_one, seeds):
            total.join(found)
            problems += wrong
    return total, problems

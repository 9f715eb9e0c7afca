"""What can go wrong, each as a thing that begins and, where it lasts, ends; and schedules of them by a seed.

A lost lease uses up one of a job's three attempts, and a job that is lost at every attempt fails by rule (poison).
So a schedule holds at most two faults that may cost a lease; everything else it may hold in any number.
"""

from __future__ import annotations

import json
import os
import random
import signal
import time
import uuid
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

import redis
from kombu.exceptions import OperationalError
from sqlalchemy import select
from sqlalchemy.exc import DBAPIError

from service.db.models import JobRow, ProcessRow
from service.domain.states import JobState
from service.queue import QUEUE_NAME, TASK_NAMES, Publisher
from tests.faults.rig import CLOCK_WORKER, Process, Rig

MOST_LOST_LEASES = 2
# Faults begin within so many seconds of the first request.
WINDOW_S = 6.0
# Killing a worker that has nothing to do shows little.
WAIT_FOR_WORK_S = 2.0


@dataclass(frozen=True)
class Injection:
    """One fault of a schedule: when it begins, what it is, how long it lasts (0: a moment)."""

    at_s: float
    name: str
    lasts_s: float = 0.0

    def __str__(self) -> str:
        lasting = f" for {self.lasts_s:.1f} s" if self.lasts_s else ""
        return f"{self.at_s:.1f} s {self.name}{lasting}"


@dataclass
class Kill:
    """A worker child that was killed while it held jobs: when (seconds since 1970), and under which id."""

    when: float
    worker_ids: tuple[str, ...]


@dataclass
class Injected:
    """What a schedule has done to the rig so far."""

    rig: Rig
    rng: random.Random
    kills: list[Kill] = field(default_factory=list)


@dataclass(frozen=True)
class Fault:
    """`lasts`: range of seconds in multiples of the lease where `by_lease`; `needs`: what the rig must have."""

    begin: Callable[[Injected], Callable[[], None] | None]
    lasts: tuple[float, float] = (0.0, 0.0)
    by_lease: bool = False
    costs_lease: bool = False
    needs: Callable[[Rig], str | None] = lambda _rig: None


def busy_worker(injected: Injected) -> Process:
    """One that holds a job, waited for a little; else any."""
    rig = injected.rig
    running = [worker for worker in rig.workers() if worker.is_running()] or rig.workers()
    deadline = time.monotonic() + WAIT_FOR_WORK_S
    busy = list[Process]()
    while not busy and time.monotonic() < deadline:
        busy = [worker for worker in running if _worker_ids(rig, worker, busy=True)]
        time.sleep(0.05)
    return injected.rng.choice(busy or running)


def _worker_ids(rig: Rig, worker: Process, busy: bool) -> tuple[str, ...]:
    statement = select(ProcessRow.id).where(ProcessRow.pid.in_(worker.children()))
    if busy:
        held = select(JobRow.worker_id).where(JobRow.state == JobState.RUNNING)
        statement = statement.where(ProcessRow.id.in_(held))
    with suppress(DBAPIError), rig.database.reading() as session:
        return tuple(session.scalars(statement))
    return ()


def kill_child(injected: Injected) -> None:
    """The process that computes dies; its parent makes another."""
    worker = busy_worker(injected)
    injected.kills.append(Kill(time.time(), _worker_ids(injected.rig, worker, busy=True)))
    for pid in worker.children():
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def kill_machine(injected: Injected) -> Callable[[], None]:
    """The worker and all that it started die at once."""
    worker = busy_worker(injected)
    injected.kills.append(Kill(time.time(), _worker_ids(injected.rig, worker, busy=True)))
    worker.kill()
    return worker.start


def kill_worker(injected: Injected) -> Callable[[], None]:
    """The parent dies alone; what it forked sees that, gives its job back and ends with the restart."""
    worker = busy_worker(injected)
    worker.kill(alone=True)

    def again() -> None:
        worker.kill()
        worker.start()

    return again


def _kill(name: str) -> Callable[[Injected], Callable[[], None]]:
    def kill(injected: Injected) -> Callable[[], None]:
        process = injected.rig.processes[name]
        process.kill()
        return process.start

    return kill


def kill_postgres(injected: Injected) -> Callable[[], None]:
    server = injected.rig.postgres
    assert server is not None
    server.kill()
    return server.start_again


def flush_all(injected: Injected) -> None:
    """Every message is gone."""
    client = redis.Redis(unix_socket_path=str(injected.rig.broker_socket), socket_timeout=5.0)
    with suppress(redis.RedisError):  # the broker is down already
        client.flushall()
    client.close()


def _black_hole(name: str) -> Callable[[Injected], Callable[[], None]]:
    def begin(injected: Injected) -> Callable[[], None]:
        proxy = injected.rig.proxies[name]
        proxy.swallow()
        return proxy.heal

    return begin


def freeze(injected: Injected) -> Callable[[], None]:
    """A worker stops in the middle of everything, past its lease, and goes on as if nothing had been."""
    worker = busy_worker(injected)
    group = worker.pid

    def signal_group(number: signal.Signals) -> None:
        with suppress(ProcessLookupError):
            os.killpg(group, number)

    signal_group(signal.SIGSTOP)
    return lambda: signal_group(signal.SIGCONT)


def duplicate(injected: Injected) -> None:
    """Every job that there is or was, told of again twice."""
    with suppress(DBAPIError), injected.rig.database.reading() as session:
        jobs = session.execute(select(JobRow.id, JobRow.kind).limit(60)).all()
        _publish(injected.rig, [(kind, job_id) for job_id, kind in jobs] * 2)


def _publish(rig: Rig, messages: list[tuple[object, str]]) -> None:
    with (
        Publisher(f"redis+socket://{rig.broker_socket}") as publisher,
        suppress(RuntimeError, OperationalError),
    ):
        for kind, job_id in messages:
            publisher.publish(kind, job_id)  # type: ignore[arg-type]


def forge(injected: Injected) -> None:
    """Messages that no dispatcher sent: unknown ids, wrong kinds, wrong arguments, no task, no message at all."""
    client = redis.Redis(unix_socket_path=str(injected.rig.broker_socket), socket_timeout=5.0)
    with suppress(redis.RedisError):
        for raw in forged_messages(injected.rng):
            client.lpush(QUEUE_NAME, raw)
    client.close()


def forged_messages(rng: random.Random) -> list[bytes]:
    """As the transport stores them, in any order."""
    unknown = str(uuid.UUID(int=rng.getrandbits(128), version=4))
    found = [
        message("talus.simulate", [unknown]),
        message("talus.propose", ["'; drop table jobs; --"]),
        message("talus.simulate", []),
        message("talus.simulate", [unknown, 1, 2]),
        message("talus.simulate", [{"job": None}]),
        message("talus.simulate", [None]),
        message("os.system", ["true"]),
        message(rng.choice(list(TASK_NAMES.values())), ["x" * 100_000]),
        message("talus.simulate", [unknown], content_type="application/x-python-serialize"),
        message("talus.simulate", [unknown], body="bm8ganNvbg=="),
        b"no json at all \xff",
        b"{}",
        b"[1, 2]",
    ]
    rng.shuffle(found)
    return found


def message(
    task: str, arguments: list[object], content_type: str = "application/json", body: str | None = None
) -> bytes:
    """A message of Celery's protocol 2 as kombu's Redis transport keeps it."""
    from base64 import b64encode

    plain = json.dumps([arguments, {}, {"callbacks": None, "errbacks": None, "chain": None, "chord": None}])
    number = str(uuid.uuid4())
    return json.dumps(
        {
            "body": body or b64encode(plain.encode()).decode(),
            "content-encoding": "utf-8",
            "content-type": content_type,
            "headers": {"lang": "py", "task": task, "id": number, "root_id": number, "parent_id": None},
            "properties": {
                "correlation_id": number,
                "delivery_mode": 2,
                "delivery_info": {"exchange": "", "routing_key": QUEUE_NAME},
                "priority": 0,
                "body_encoding": "base64",
                "delivery_tag": number,
            },
        }
    ).encode()


def move_clock(injected: Injected) -> Callable[[], None]:
    """One worker's clock goes three hours fast, or slow; its monotonic one goes on."""
    rig = injected.rig
    rig.set_clock(injected.rng.choice(["+3h", "-3h"]))
    return lambda: rig.set_clock("+0")


def fill_disk(injected: Injected) -> Callable[[], None]:
    """Not a byte is left on the disk of the data folder: SQLite, checkpoints, artifacts, the broker's file."""
    path = injected.rig.ballast
    with suppress(OSError), path.open("wb") as file:
        while True:
            file.write(b"\0" * 2**20)
            file.flush()
    with suppress(OSError), path.open("ab") as file:
        while True:
            file.write(b"\0" * 512)
            file.flush()
    return lambda: path.unlink(missing_ok=True)


def _needs_postgres(rig: Rig) -> str | None:
    return None if rig.postgres is not None else "SQLite has no server"


def _needs_clock(rig: Rig) -> str | None:
    return None if rig.can_move_clock else "libfaketime is not installed"


def _needs_small_disk(rig: Rig) -> str | None:
    return None if rig.has_small_disk else "this user may not mount a tmpfs"


DOWN = (0.0, 3.0)
FAULTS: dict[str, Fault] = {
    "kill -9 of a worker's child": Fault(kill_child, costs_lease=True),
    "kill -9 of a worker with its child": Fault(kill_machine, DOWN, costs_lease=True),
    "kill -9 of a worker alone": Fault(kill_worker, DOWN, costs_lease=True),
    "kill -9 of the dispatcher": Fault(_kill("dispatcher"), DOWN),
    "kill -9 of the API": Fault(_kill("api"), DOWN),
    "kill -9 of the broker": Fault(_kill("broker"), DOWN),
    "kill -9 of PostgreSQL": Fault(kill_postgres, (0.0, 1.5), needs=_needs_postgres),
    "FLUSHALL": Fault(flush_all),
    "black hole before the broker": Fault(_black_hole("broker"), (0.5, 7.0)),
    "black hole before PostgreSQL": Fault(
        _black_hole("postgresql"), (0.2, 2.0), by_lease=True, costs_lease=True, needs=_needs_postgres
    ),
    "SIGSTOP past the lease": Fault(freeze, (1.2, 1.8), by_lease=True, costs_lease=True),
    "every message twice more": Fault(duplicate),
    "forged messages": Fault(forge),
    f"the clock of {CLOCK_WORKER} off by 3 h": Fault(move_clock, (1.0, 6.0), needs=_needs_clock),
    "disk full": Fault(fill_disk, (0.5, 4.0), costs_lease=True, needs=_needs_small_disk),
}


# A lease that runs out meanwhile is noticed when they are over.
HINDER_REAPING = frozenset(
    {"kill -9 of the dispatcher", "kill -9 of PostgreSQL", "black hole before PostgreSQL", "disk full"}
)
assert FAULTS.keys() >= HINDER_REAPING


def draw_schedule(rng: random.Random, rig: Rig, window_s: float = WINDOW_S) -> list[Injection]:
    """Two to five faults at random moments, in the order in which they begin."""
    possible = [name for name, fault in FAULTS.items() if fault.needs(rig) is None]
    drawn, lost = list[Injection](), 0
    for _ in range(rng.randint(2, 5)):
        name = rng.choice(possible)
        fault = FAULTS[name]
        if fault.costs_lease and lost == MOST_LOST_LEASES:
            name = rng.choice([other for other in possible if not FAULTS[other].costs_lease])
            fault = FAULTS[name]
        lost += fault.costs_lease
        lasts = rng.uniform(*fault.lasts) * (rig.settings.lease_seconds if fault.by_lease else 1.0)
        drawn.append(Injection(rng.uniform(0.2, window_s), name, lasts))
    return sorted(drawn, key=lambda injection: injection.at_s)


def left_out(rig: Rig) -> dict[str, str]:
    """Faults that this rig cannot have, with the reason."""
    reasons = {name: fault.needs(rig) for name, fault in FAULTS.items()}
    return {name: reason for name, reason in reasons.items() if reason is not None}


def inject(schedule: list[Injection], injected: Injected) -> None:
    """Begin and end every fault at its moment. Ends come in any order; an ended fault may overlap the next."""
    started = time.monotonic()
    ends: list[tuple[float, Callable[[], None]]] = []

    def wait_until(moment: float) -> None:
        while ends and min(ends, key=lambda end: end[0])[0] <= moment:
            first = min(ends, key=lambda end: end[0])
            ends.remove(first)
            time.sleep(max(0.0, started + first[0] - time.monotonic()))
            first[1]()
        time.sleep(max(0.0, started + moment - time.monotonic()) if moment != float("inf") else 0.0)

    for injection in schedule:
        wait_until(injection.at_s)
        end = FAULTS[injection.name].begin(injected)
        if end is not None:
            ends.append((injection.at_s + injection.lasts_s, end))
    wait_until(float("inf"))

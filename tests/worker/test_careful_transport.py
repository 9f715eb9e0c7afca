"""A worker's consumer goes on after whatever lies in its queue, and takes the message behind it."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path

import pytest
from celery import Celery
from kombu import Connection, Queue
from kombu.transport import TRANSPORT_ALIASES

from service.domain.states import JobKind
from service.queue import QUEUE_NAME, TASK_NAMES
from service.settings import Settings
from tests.builders.refusals import REFUSALS, Refusal, Server, running_valkey
from tests.faults.faults import forged_messages, message
from worker.careful_transport import use_careful_transport

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def valkey(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with running_valkey(Settings(data_dir=tmp_path_factory.mktemp("d"))) as server:
        yield server


@pytest.fixture
def careful() -> Iterator[None]:
    before = dict(TRANSPORT_ALIASES)
    use_careful_transport()
    yield
    TRANSPORT_ALIASES.update(before)


def test_what_is_no_message_is_dropped_and_the_next_one_is_read(valkey: Server, careful: None) -> None:
    for raw in (*forged_messages(random.Random(1)), b"\x80\x04", b"null", b'"text"', message("last", [])):
        valkey.client.lpush(QUEUE_NAME, raw)
    tasks = list[str]()

    with Connection(valkey.settings.resolved_broker_url) as connection:
        consumer = connection.Consumer(
            Queue(QUEUE_NAME, no_ack=True),
            accept=["json"],
            on_message=lambda found: tasks.append(found.headers["task"]),
        )
        consumer.no_ack = True
        with consumer:
            deadline = time.monotonic() + 60.0
            while "last" not in tasks and time.monotonic() < deadline:
                try:
                    connection.drain_events(timeout=2.0)
                except TimeoutError:
                    continue
    assert tasks[-1] == "last"
    assert tasks.count("talus.simulate") >= 6


class IdleWorker:
    """A worker process under test: what it says, and whether it takes messages."""

    def __init__(self, server: Server, folder: Path) -> None:
        self._server, self._log = server, folder / "log"
        command = [sys.executable, "-m", "celery", "--app", "tests.builders.idle_worker", "worker"]
        options = ["--pool", "prefork", "--concurrency", "1", "--without-gossip", "--without-mingle"]
        with self._log.open("wb") as output:
            self.process = subprocess.Popen(
                [*command, *options],
                env={**os.environ, "TALUS_DATA_DIR": str(server.settings.data_dir)},
                cwd=ROOT,
                stdout=output,
                stderr=output,
                start_new_session=True,
            )

    def wait_until(self, is_so: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + 120.0
        while not is_so():
            words = f"{what}:\n{self._log.read_text()[-3000:]}"
            assert self.process.poll() is None, f"it ended before {words}"
            assert time.monotonic() < deadline, f"not within 120 s: {words}"
            time.sleep(0.05)

    def said(self, text: str) -> int:
        return self._log.read_text().count(text)

    def takes(self, raw: bytes) -> None:
        self._server.client.lpush(QUEUE_NAME, raw)
        self.wait_until(lambda: self._server.client.llen(QUEUE_NAME) == 0, "the message is taken")

    def end(self) -> None:
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()


@pytest.fixture
def idle_worker(valkey: Server, tmp_path: Path) -> Iterator[IdleWorker]:
    """Started while the broker's memory is full."""
    REFUSALS["memory full"].begin(valkey)
    found = IdleWorker(valkey, tmp_path)
    yield found
    found.end()


def test_a_worker_waits_for_a_broker_that_refuses_writes(valkey: Server, idle_worker: IdleWorker) -> None:
    """One test for all refusals, because a worker takes seconds to start."""
    at_start = REFUSALS["memory full"]
    idle_worker.wait_until(lambda: idle_worker.said(at_start.text) > 1, "a start that waits")
    at_start.end(valkey)
    idle_worker.takes(message(TASK_NAMES[JobKind.SIMULATE], ["id"]))
    for name, refusal in REFUSALS.items():
        refusal.begin(valkey)
        if refusal.stops_reading:
            idle_worker.wait_until(partial(_has_asked_twice, idle_worker, refusal), f"it noticed: {name}")
        refusal.end(valkey)
        for _ in range(3):
            idle_worker.takes(message(TASK_NAMES[JobKind.SIMULATE], ["id"]))
    # A worker of Celery's defaults ends when anybody who can write to the broker says so.
    with Celery(broker=valkey.settings.resolved_broker_url, set_as_current=False) as stranger:
        stranger.control.shutdown()
    idle_worker.takes(message(TASK_NAMES[JobKind.SIMULATE], ["id"]))
    idle_worker.process.send_signal(signal.SIGTERM)
    assert idle_worker.process.wait(timeout=60.0) == 0


def _has_asked_twice(worker: IdleWorker, refusal: Refusal) -> bool:
    return worker.said(refusal.text) > 1


def test_the_worker_uses_it() -> None:
    """In a process of its own: the alias is the process' for good."""
    program = "import worker.app; print(type(worker.app.app.connection().transport).__name__)"
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    assert done.stdout.split()[-1] == "CarefulTransport"

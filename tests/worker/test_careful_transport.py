"""A worker's consumer goes on after whatever lies in its queue, and takes the message behind it."""

from __future__ import annotations

import random
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import redis
from kombu import Connection, Queue
from kombu.transport import TRANSPORT_ALIASES

from service import broker
from service.queue import QUEUE_NAME
from service.settings import Settings
from tests.faults.faults import forged_messages, message
from worker.careful_transport import use_careful_transport


@pytest.fixture
def valkey(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Settings]:
    settings = Settings(data_dir=tmp_path_factory.mktemp("d"))
    broker.prepare_folders(settings)
    server = subprocess.Popen(broker.server_command(settings), stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 30.0
    while not broker.is_up(settings.resolved_broker_url):
        assert time.monotonic() < deadline, "the broker does not start"
        time.sleep(0.02)
    yield settings
    server.kill()
    server.wait()


@pytest.fixture
def careful() -> Iterator[None]:
    before = dict(TRANSPORT_ALIASES)
    use_careful_transport()
    yield
    TRANSPORT_ALIASES.update(before)


def test_what_is_no_message_is_dropped_and_the_next_one_is_read(valkey: Settings, careful: None) -> None:
    client = redis.Redis(unix_socket_path=str(valkey.broker_socket))
    for raw in (*forged_messages(random.Random(1)), b"\x80\x04", b"null", b'"text"', message("last", [])):
        client.lpush(QUEUE_NAME, raw)
    client.close()
    tasks = list[str]()

    with Connection(valkey.resolved_broker_url) as connection:
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


def test_the_worker_uses_it() -> None:
    """In a process of its own: the alias is the process' for good."""
    import sys

    program = "import worker.app; print(type(worker.app.app.connection().transport).__name__)"
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).resolve().parents[2],
    )
    assert done.stdout.split()[-1] == "CarefulTransport"

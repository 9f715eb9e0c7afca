"""A real Valkey, and the ways in which one that is up refuses to take what it is given."""

from __future__ import annotations

import resource
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import redis

from service import broker
from service.queue import QUEUE_NAME
from service.settings import Settings

PATIENCE_S = 30.0
UNLIMITED = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)


@dataclass(frozen=True)
class Server:
    """One that runs, and a client of it."""

    settings: Settings
    pid: int
    client: redis.Redis

    def wait_for_write(self, is_taken: bool) -> None:
        """Until a write to another key than the queue's is taken, or refused."""
        deadline = time.monotonic() + PATIENCE_S
        while self._takes_write() is not is_taken:
            assert time.monotonic() < deadline, f"writes are {'refused' if is_taken else 'taken'}"
            time.sleep(0.02)

    def _takes_write(self) -> bool:
        try:
            self.client.set("test", "x" * 100)
        except redis.ResponseError:
            return False
        return True


@contextmanager
def running_valkey(settings: Settings) -> Iterator[Server]:
    """The embedded broker; a file that may not grow is an error for it, not its end."""
    broker.prepare_folders(settings)
    server = subprocess.Popen(
        broker.server_command(settings),
        stdout=subprocess.DEVNULL,
        preexec_fn=lambda: signal.signal(signal.SIGXFSZ, signal.SIG_IGN),
    )
    client = redis.Redis(unix_socket_path=str(settings.broker_socket))
    try:
        deadline = time.monotonic() + PATIENCE_S
        while not broker.is_up(settings.resolved_broker_url):
            assert time.monotonic() < deadline, "the broker does not start"
            time.sleep(0.02)
        yield Server(settings, server.pid, client)
    finally:
        client.close()
        server.kill()
        server.wait()


@dataclass(frozen=True)
class Refusal:
    """One way: `text` is in what the broker then answers, `stops_reading` where it hands out nothing either."""

    text: str
    begin: Callable[[Server], object]
    end: Callable[[Server], object]
    stops_reading: bool = True


def _no_room_for_file(server: Server) -> None:
    """As on a full disk: not a byte more in the append-only file."""
    resource.prlimit(server.pid, resource.RLIMIT_FSIZE, (1, resource.RLIM_INFINITY))
    server.wait_for_write(False)


def _room_for_file(server: Server) -> None:
    resource.prlimit(server.pid, resource.RLIMIT_FSIZE, UNLIMITED)
    server.wait_for_write(True)


def _configured(
    name: str, bad: str, good: str
) -> tuple[Callable[[Server], object], Callable[[Server], object]]:
    return (
        lambda server: server.client.config_set(name, bad),
        lambda server: server.client.config_set(name, good),
    )


REFUSALS = {
    "disk full": Refusal("MISCONF", _no_room_for_file, _room_for_file),
    # Taking a message needs no memory.
    "memory full": Refusal("'maxmemory'", *_configured("maxmemory", "1", "0"), stops_reading=False),
    "no replicas": Refusal("NOREPLICAS", *_configured("min-replicas-to-write", "1", "0")),
    "a replica": Refusal(
        "read only replica",
        lambda server: server.client.replicaof("127.0.0.1", "1"),
        lambda server: server.client.replicaof("NO", "ONE"),
    ),
    "queue is no list": Refusal(
        "WRONGTYPE",
        lambda server: server.client.set(QUEUE_NAME, "x"),
        lambda server: server.client.delete(QUEUE_NAME),
    ),
    "no right to write": Refusal(
        "has no permissions",
        lambda server: server.client.acl_setuser("default", enabled=True, categories=["-@write"]),
        lambda server: server.client.acl_setuser("default", enabled=True, categories=["+@all"]),
    ),
}

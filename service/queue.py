"""The broker's side of a job: a message that says "look at this row", sent by task name.

The worker is never imported here. A message may be lost, doubled or late without harm: the row decides.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Self

from celery import Celery
from kombu.exceptions import OperationalError

from service.domain.states import JobKind

QUEUE_NAME = "talus"

TASK_NAMES = {
    JobKind.PROPOSE: "talus.propose",
    JobKind.SIMULATE: "talus.simulate",
    JobKind.RECOMMEND: "talus.recommend",
    JobKind.REPORT: "talus.report",
    JobKind.CHARGE: "talus.charge",
    JobKind.DIAGNOSE: "talus.diagnose",
}

# A key in the broker that goes when its data go.
NOTE = "talus:published-in"

# Written only to see whether anything can be: a broker that refuses writes may still answer a PING or a read.
PROBE = "talus:takes-writes"

# A broker that does not answer within this long counts as away.
SOCKET_TIMEOUT_S = 5.0

BROKER_SETTINGS: dict[str, Any] = {
    "task_default_queue": QUEUE_NAME,
    "task_ignore_result": True,
    "task_serializer": "json",
    "accept_content": ["json"],
    "broker_transport_options": {
        "socket_timeout": SOCKET_TIMEOUT_S,
        "socket_connect_timeout": SOCKET_TIMEOUT_S,
        "max_retries": 0,
        # The row is the truth, so kombu need not note in the broker which messages are out; a note that the broker
        # refuses to take back counts as a message in hand, and a worker with one in hand asks for no other.
        "ack_emulation": False,
    },
}


class BrokerAway(RuntimeError):
    """The broker did not take a message."""


def try_broker(client: Any) -> None:
    """Raises redis.RedisError unless the queue can be read and something can be written."""
    client.llen(QUEUE_NAME)
    client.set(PROBE, 1)


class Publisher:
    """Sends job ids to the broker over one connection, which is made again after a failure."""

    def __init__(self, broker_url: str) -> None:
        self._app = Celery("talus-publisher", broker=broker_url, set_as_current=False)
        self._app.conf.update(BROKER_SETTINGS)
        self._connection: Any = None

    def publish(self, kind: JobKind, job_id: str) -> None:
        """Raises BrokerAway; the message may then have been sent nevertheless."""
        with self._connected() as connection:
            self._app.send_task(TASK_NAMES[kind], args=[job_id], connection=connection, retry=False)

    def keeps_messages(self) -> bool:
        """False where the broker started anew or was emptied since anybody asked last: messages may be lost.

        It keeps a note of which of its starts it was asked in. Raises BrokerAway.
        """
        with self._connected() as connection:
            client = connection.default_channel.client
            start = str(client.info("server").get("run_id", ""))
            before = client.set(NOTE, start, get=True)
        return before is not None and before == start.encode()

    def check(self) -> None:
        """Raises BrokerAway unless the broker takes messages."""
        with self._connected() as connection:
            try_broker(connection.default_channel.client)

    @contextmanager
    def _connected(self) -> Iterator[Any]:
        if self._connection is None:
            self._connection = self._app.connection_for_write()
        connection = self._connection
        errors = (OperationalError, OSError, *connection.connection_errors, *connection.channel_errors)
        try:
            yield connection
        except errors as error:
            self.close()
            raise BrokerAway(f"{type(error).__name__}: {error}") from error

    def close(self) -> None:
        """Drop the connection; the next publish makes a new one."""
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

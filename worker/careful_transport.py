"""kombu's Redis transport, which ends a worker over what it receives; this one reads on, or waits and asks again.

Two things end the worker of kombu's own. Something that is no message: whoever can write to the broker could end
every worker, and the job that it holds, with one line; it is dropped. And every refusal: a broker whose disk or
memory is full, one that has become a replica or lost its own, one whose rights or keys were changed; it counts as
a broker that is away, which is asked again every few seconds until it takes writes.
"""

from __future__ import annotations

from typing import Any

import structlog
from celery.app.amqp import AMQP
from kombu import Connection, transport
from kombu.transport.redis import Channel, Transport
from redis import RedisError

from service.queue import try_broker

log = structlog.get_logger(__name__)

# What reading raises where an item is no JSON, no message, or one without its parts.
NO_MESSAGE = (ValueError, KeyError, TypeError, AttributeError)

# Celery's own pauses grow to 30 s, and for so long the queue would wait for its workers after an outage.
ASK_AGAIN_S = 2.0


class CarefulChannel(Channel):
    """Reads on after what is no message."""

    def _brpop_read(self, **options: Any) -> Any:
        try:
            return super()._brpop_read(**options)  # type: ignore[misc]
        except NO_MESSAGE as error:
            log.warning("dropped what is no message", problem=f"{type(error).__name__}: {error}"[:200])
            return True


class CarefulTransport(Transport):
    """As kombu's, over these channels; a refusal is a lost connection."""

    Channel = CarefulChannel
    # Refusals are known by their texts (MISCONF, NOREPLICAS, WRONGTYPE, ...) and have no classes of their own.
    connection_errors = (*Transport.connection_errors, RedisError)

    def create_channel(self, connection: Any) -> Any:
        """Raises redis.RedisError where the broker refuses, too.

        Asked here, where whoever connects pauses between its tries: a refusal later restarts the consumer at once.
        """
        channel: Any = super().create_channel(connection)
        try:
            try_broker(channel.client)
        except RedisError:
            channel.close()
            raise
        return channel


class SteadyConnection(Connection):
    """Tries again after the same short pause each time."""

    def ensure_connection(self, *args: Any, **kwargs: Any) -> Any:
        """As kombu's, with these pauses."""
        pauses = {"interval_start": ASK_AGAIN_S, "interval_step": 0.0, "interval_max": ASK_AGAIN_S}
        return super().ensure_connection(*args, **{**kwargs, **pauses})


class SteadyAMQP(AMQP):
    """What a Celery application makes its connections with."""

    Connection = SteadyConnection


def use_careful_transport() -> None:
    """From now on this process' Redis URLs mean this transport."""
    for scheme in ("redis", "rediss"):
        transport.TRANSPORT_ALIASES[scheme] = f"{__name__}:{CarefulTransport.__name__}"

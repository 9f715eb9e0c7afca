"""kombu's Redis transport, which ends a worker that receives something else than a message; this one drops it.

Whoever can write to the broker could otherwise end every worker, and the job that it holds, with one line.
"""

from __future__ import annotations

from typing import Any

import structlog
from kombu import transport
from kombu.transport.redis import Channel, Transport

log = structlog.get_logger(__name__)

# What reading raises where an item is no JSON, no message, or one without its parts.
NO_MESSAGE = (ValueError, KeyError, TypeError, AttributeError)


class CarefulChannel(Channel):
    """Reads on after what is no message."""

    def _brpop_read(self, **options: Any) -> Any:
        try:
            return super()._brpop_read(**options)  # type: ignore[misc]
        except NO_MESSAGE as error:
            log.warning("dropped what is no message", problem=f"{type(error).__name__}: {error}"[:200])
            return True


class CarefulTransport(Transport):
    """As kombu's, over these channels."""

    Channel = CarefulChannel


def use_careful_transport() -> None:
    """From now on this process' Redis URLs mean this transport."""
    for scheme in ("redis", "rediss"):
        transport.TRANSPORT_ALIASES[scheme] = f"{__name__}:{CarefulTransport.__name__}"

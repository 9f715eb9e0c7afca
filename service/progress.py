"""Event rows as a stream: what happened to a study since a cursor, then whatever happens next.

Stored events carry their id, so that a client that comes back names the last one it saw and misses nothing.
Progress of running simulations is told in between without an id: it is a state, not an event, and not stored.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass
from typing import Any

POLL_SECONDS = 0.5


@dataclass(frozen=True)
class StreamItem:
    """One event of a stream; `id` None for progress."""

    kind: str
    data: dict[str, Any]
    id: int | None = None


@dataclass(frozen=True)
class Glance:
    """What one look at the database gives: events since the cursor, running work, whether more can come."""

    events: Sequence[StreamItem]
    progress: Sequence[StreamItem]
    is_over: bool


Look = Callable[[int], Glance]


async def follow(look: Look, after: int, poll_seconds: float = POLL_SECONDS) -> AsyncIterator[StreamItem]:
    """Everything after the event `after`, in order; ends when the study is over and all of it is told."""
    told: dict[str, StreamItem] = {}
    while True:
        glance = await asyncio.to_thread(look, after)
        for event in glance.events:
            after = event.id if event.id is not None else after
            yield event
        for item in glance.progress:
            key = str(item.data.get("number"))
            if told.get(key) != item:
                told[key] = item
                yield item
        if glance.is_over and not glance.events:
            return
        if not glance.events:
            await asyncio.sleep(poll_seconds)

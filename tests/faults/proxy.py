"""A stream proxy on a unix socket that can become a black hole: connections stay open and nothing comes through.

It runs on a thread of its own, so that whoever injects faults may block.
"""

from __future__ import annotations

import asyncio
import threading
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

CHUNK = 65_536


class BlackHole:
    """Forwards `listens` to `target` (both unix sockets) until `swallow`, and again after `heal`."""

    def __init__(self, listens: Path, target: Path) -> None:
        self.listens, self.target = listens, target
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name=f"proxy of {target.name}", daemon=True)
        self._ready = threading.Event()
        self._open: asyncio.Event | None = None
        self._links: set[asyncio.Task[None]] = set()
        self._stop: asyncio.Event | None = None

    def swallow(self) -> None:
        """From now on nothing comes through, in either direction; new connections are taken and not answered."""
        assert self._open is not None
        self._loop.call_soon_threadsafe(self._open.clear)

    def heal(self) -> None:
        """Forward again. What was connected has lost bytes, so it is cut: clients must connect anew."""
        self._loop.call_soon_threadsafe(self._cut_and_open)

    def _cut_and_open(self) -> None:
        assert self._open is not None
        if not self._open.is_set():
            for link in self._links:
                link.cancel()
            self._open.set()

    def __enter__(self) -> Self:
        self._thread.start()
        assert self._ready.wait(10.0), "the proxy does not start"
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._stop is not None
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(10.0)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_until_complete(self._serve())
        self._loop.close()

    async def _serve(self) -> None:
        self._open, self._stop = asyncio.Event(), asyncio.Event()
        self._open.set()
        server = await asyncio.start_unix_server(self._accept, self.listens)
        self.listens.chmod(0o777)  # PostgreSQL's clients run as another user than its server
        self._ready.set()
        await self._stop.wait()
        server.close()
        for link in list(self._links):
            link.cancel()
        await asyncio.gather(*self._links, return_exceptions=True)

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        link = self._loop.create_task(self._link(reader, writer))
        self._links.add(link)
        link.add_done_callback(self._links.discard)

    async def _link(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        ends = [writer]
        try:
            await self._gate()
            target_reader, target_writer = await asyncio.open_unix_connection(self.target)
            ends.append(target_writer)
            pumps = [
                asyncio.ensure_future(self._pump(reader, target_writer)),
                asyncio.ensure_future(self._pump(target_reader, writer)),
            ]
            try:
                await asyncio.wait(pumps, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for pump in pumps:
                    pump.cancel()
        except (OSError, asyncio.CancelledError):
            pass  # the target is down, or the link was cut: the client sees its connection end
        finally:
            for end in ends:
                end.transport.abort()

    async def _pump(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(OSError):
            while chunk := await reader.read(CHUNK):
                await self._gate()
                writer.write(chunk)
                await writer.drain()

    async def _gate(self) -> None:
        assert self._open is not None
        await self._open.wait()

"""Refuses request bodies that are too large before anything parses them."""

from __future__ import annotations

from collections.abc import Mapping

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.problems import problem_response
from service.errors import FieldError, InvalidRequest

# A client that still sends when it is answered sees a broken connection instead of the answer. So what is too
# much is read and dropped, up to this many bytes.
DRAINED_BYTES = 64_000_000


class BodyLimit:
    """ASGI middleware: hands on bodies of at most `max_bytes`, whole, and answers 422 to larger ones.

    `by_path`: paths that take larger (or only smaller) ones.
    """

    def __init__(self, app: ASGIApp, max_bytes: int, by_path: Mapping[str, int]) -> None:
        self.app = app
        self.max_bytes = max_bytes
        self.by_path = by_path

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] in ("GET", "HEAD", "OPTIONS"):
            await self.app(scope, receive, send)
            return
        most = self.by_path.get(scope["path"], self.max_bytes)
        chunks: list[bytes] = []
        size, more = 0, True
        while more and size <= max(DRAINED_BYTES, most):
            message = await receive()
            if message["type"] == "http.disconnect":
                return
            chunk = message.get("body", b"")
            size += len(chunk)
            more = message.get("more_body", False)
            if size <= most:
                chunks.append(chunk)
        if size > most:
            await self._refuse(size, most, scope, receive, send)
            return
        await self.app(scope, _replay(b"".join(chunks), receive), send)

    async def _refuse(self, size: int, most: int, scope: Scope, receive: Receive, send: Send) -> None:
        error = FieldError("body", f"{size} bytes", f"at most {most} bytes")
        await problem_response(InvalidRequest.of(error))(scope, receive, send)


def _replay(body: bytes, receive: Receive) -> Receive:
    waiting = [{"type": "http.request", "body": body, "more_body": False}]

    async def replayed() -> Message:
        return waiting.pop() if waiting else await receive()

    return replayed

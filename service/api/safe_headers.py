"""Headers that every answer has, whoever made it: a page that brings its own policy keeps it.

Answers of the API are data. Opened in a browser they load nothing, run nothing and stand in no other page's frame.
"""

from __future__ import annotations

from collections.abc import Mapping

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

SAFE_HEADERS: Mapping[str, str] = {
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    # What needs a key may not lie in a cache that others use.
    "Cache-Control": "no-store",
}


def add_safe_headers(headers: MutableHeaders) -> None:
    """Those that are not there yet."""
    for name, value in SAFE_HEADERS.items():
        headers.setdefault(name, value)


class SafeHeaders:
    """ASGI middleware around everything else."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def send_safely(message: Message) -> None:
            if message["type"] == "http.response.start":
                add_safe_headers(MutableHeaders(scope=message))
            await send(message)

        await self.app(scope, receive, send_safely if scope["type"] == "http" else send)

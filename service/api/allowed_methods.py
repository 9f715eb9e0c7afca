"""Which methods an address of the API takes: any other is 405, and the answer names all that it takes.

Routing alone names the methods of the first route that fits only, and reads `GET /v1/charges/comparison`, which is
no route, as the charge with the id "comparison".
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cached_property
from typing import Any

from starlette.routing import compile_path
from starlette.types import ASGIApp, Receive, Scope, Send

from service.api.problems import problem_response
from service.errors import MethodNotAllowed

METHODS = frozenset({"get", "put", "post", "delete", "options", "head", "patch", "trace"})


class AllowedMethods:
    """ASGI middleware. `document` gives the OpenAPI document, where every address stands with its methods."""

    def __init__(self, app: ASGIApp, document: Callable[[], dict[str, Any]]) -> None:
        self.app = app
        self._document = document

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http":
            allowed = self._allowed(scope["path"])
            if allowed and scope["method"] not in allowed:
                await problem_response(MethodNotAllowed(scope["method"], allowed))(scope, receive, send)
                return
        await self.app(scope, receive, send)

    def _allowed(self, path: str) -> tuple[str, ...]:
        """Sorted; none where the address is not the API's."""
        exact = self._by_path.get(path)
        if exact is not None:
            return exact
        return next((methods for pattern, methods in self._by_pattern if pattern.match(path)), ())

    @cached_property
    def _by_path(self) -> dict[str, tuple[str, ...]]:
        return {
            path: tuple(sorted(method.upper() for method in METHODS & item.keys()))
            for path, item in self._document()["paths"].items()
        }

    @cached_property
    def _by_pattern(self) -> list[tuple[re.Pattern[str], tuple[str, ...]]]:
        return [(compile_path(path)[0], methods) for path, methods in self._by_path.items() if "{" in path]

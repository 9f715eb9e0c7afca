"""Who asks, and may they: one gate before every route, closed where it does not know better.

A program sends `Authorization: Bearer talus_...`; a browser logs in once with the same key and then sends a
cookie, which a page of another site cannot use (SameSite, and unsafe requests must come from our own pages).
"""

from __future__ import annotations

import asyncio
from http.cookies import CookieError, SimpleCookie
from urllib.parse import quote

from sqlalchemy.exc import DBAPIError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from starlette.datastructures import Headers
from starlette.responses import RedirectResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from service.api.problems import database_away, problem_response
from service.db.session import Database
from service.domain.access import Principal
from service.domain.access import Scope as KeyScope
from service.errors import Forbidden, Problem, Unauthorized
from service.studies.log_in import COOKIE, LOGIN, key_of_session, key_of_text

SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
# What needs no key: that the process lives and is ready (for load balancers), the pages' style, and login.
OPEN_PATHS = ("/v1/health/live", "/v1/health/ready", LOGIN)
OPEN_FOLDER = "/static/"
ADMIN_FOLDER = "/v1/keys"
PROGRAM_PATHS = ("/metrics", "/openapi.json")
# Who asks where no keys are asked for: whoever reaches the port.
ANYBODY = Principal(KeyScope.ADMIN, None)


class Gate:
    """ASGI middleware: puts a Principal into the request's state, or refuses."""

    def __init__(self, app: ASGIApp, database: Database, asks_for_keys: bool) -> None:
        self.app = app
        self._database = database
        self._asks = asks_for_keys

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        try:
            scope.setdefault("state", {})["principal"] = await self._let_in(scope, headers)
        except (DBAPIError, PoolTimeout):
            await database_away()(scope, receive, send)
        except Unauthorized as problem:
            if _is_page(scope):
                there = quote(scope["path"], safe="/")
                await RedirectResponse(f"{LOGIN}?next={there}", 303)(scope, receive, send)
            else:
                await problem_response(problem)(scope, receive, send)
        except Problem as problem:
            await problem_response(problem)(scope, receive, send)
        else:
            await self.app(scope, receive, send)

    async def _let_in(self, scope: Scope, headers: Headers) -> Principal:
        is_safe = scope["method"] in SAFE_METHODS
        if not is_safe and not _is_from_here(headers):
            raise Forbidden("A page of another site may not change anything here.")
        path = scope["path"]
        if not self._asks:
            return ANYBODY
        if path in OPEN_PATHS or path.startswith(OPEN_FOLDER):
            return Principal(KeyScope.READ, None)
        principal = await asyncio.to_thread(self._identify, headers)
        needed = needed_scope(scope["method"], path)
        if not principal.scope.includes(needed):
            raise Forbidden(
                f"This needs a key of scope {needed.value}; this key's is {principal.scope.value}."
            )
        return principal

    def _identify(self, headers: Headers) -> Principal:
        authorization = headers.get("authorization")
        with self._database.reading() as session:
            if authorization is not None:
                kind, _, text = authorization.partition(" ")
                row = key_of_text(session, text) if kind.lower() == "bearer" else None
            else:
                row = key_of_session(session, _cookie(headers))
        if row is None:
            raise Unauthorized("Send a key that is valid: Authorization: Bearer talus_...")
        return Principal(row.scope, row.project, row.prefix)


def needed_scope(method: str, path: str) -> KeyScope:
    """What a request needs: to look is `read`, anything else `run`, keys are for `admin`."""
    if path == ADMIN_FOLDER or path.startswith(ADMIN_FOLDER + "/"):
        return KeyScope.ADMIN
    return KeyScope.READ if method in SAFE_METHODS or path == "/logout" else KeyScope.RUN


def _is_page(scope: Scope) -> bool:
    path = scope["path"]
    # What a page's script asks for must be refused as what it is: a login form is no answer to it.
    is_of_a_script = path.endswith("/parts") or "/scene" in path
    is_for_programs = path.startswith("/v1/") or is_of_a_script or path in PROGRAM_PATHS
    return scope["method"] == "GET" and not is_for_programs


def _is_from_here(headers: Headers) -> bool:
    """Browsers say where a request comes from; programs say nothing."""
    site = headers.get("sec-fetch-site")
    if site is not None:
        return site in ("same-origin", "none")
    origin = headers.get("origin")
    return origin is None or origin.partition("://")[2] == headers.get("host")


def _cookie(headers: Headers) -> str:
    try:
        morsel = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        return ""
    return "" if morsel is None else morsel.value

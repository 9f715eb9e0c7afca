"""A browser's way in: a key is typed once, a cookie stands for it for twelve hours."""

from __future__ import annotations

import asyncio
from typing import Annotated
from urllib.parse import parse_qs

from fastapi import APIRouter, Query, Request, Response
from starlette.responses import RedirectResponse

from service.dashboard.rendering import HEADERS, PageRoute, page
from service.db.session import Database
from service.studies.log_in import COOKIE, LOGIN, SESSION_S, open_session

router = APIRouter(include_in_schema=False, route_class=PageRoute)

Next = Annotated[str, Query(max_length=500)]


@router.get(LOGIN)
def login_page(next: Next = "/") -> Response:  # noqa: A002 (the parameter's name in the address)
    """The form."""
    return _form(_local(next))


@router.post(LOGIN)
async def post_login(request: Request) -> Response:
    """Opens a session."""
    fields = parse_qs((await request.body()).decode("utf-8", "replace"), max_num_fields=5)
    there = _local(fields.get("next", ["/"])[0])
    database = request.app.state.database
    assert isinstance(database, Database)
    cookie = await asyncio.to_thread(_open, database, fields.get("key", [""])[0])
    if cookie is None:
        return _form(there, 401, "This key is not known here, or was revoked.")
    answer = RedirectResponse(there, 303, headers=dict(HEADERS))
    answer.set_cookie(
        COOKIE,
        cookie,
        max_age=SESSION_S,
        httponly=True,
        samesite="strict",
        secure=request.url.scheme == "https",
    )
    return answer


@router.post("/logout")
def post_logout() -> Response:
    """Forgets the cookie here; revoking the key ends the session everywhere."""
    answer = RedirectResponse(LOGIN, 303, headers=dict(HEADERS))
    answer.delete_cookie(COOKIE, httponly=True, samesite="strict")
    return answer


def _open(database: Database, key: str) -> str | None:
    with database.reading() as session:
        return open_session(session, key)


def _form(there: str, status: int = 200, problem: str = "") -> Response:
    # The one page with a form: it may send it home.
    policy = HEADERS["Content-Security-Policy"].replace("form-action 'none'", "form-action 'self'")
    return page("login.html", status, {"Content-Security-Policy": policy}, there=there, problem=problem)


def _local(address: str) -> str:
    """An address on this site: never another's, however it is written."""
    is_local = address.startswith("/") and not address.startswith(("//", "/\\")) and address.isprintable()
    return address if is_local and "\\" not in address else "/"

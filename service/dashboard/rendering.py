"""Templates become answers: the Jinja environment, the security headers, and errors as pages."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Mapping
from functools import lru_cache
from typing import Any

from fastapi import Request, Response
from fastapi.responses import HTMLResponse
from fastapi.routing import APIRoute
from jinja2 import Environment, PackageLoader, StrictUndefined
from sqlalchemy.exc import InterfaceError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeout

from service.dashboard import assets, formats, words
from service.domain.misfit_words import place
from service.errors import NotFound, Unavailable
from service.file_store import StoreAway

# plotly's picture of a chart (its PNG button) goes through data: and blob: addresses.
POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data: blob:",
        "connect-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)
HEADERS: Mapping[str, str] = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
    "Cache-Control": "no-store",
}


@lru_cache(maxsize=1)
def environment() -> Environment:
    """Everything is escaped; an unknown name is an error instead of an empty text."""
    made = Environment(
        loader=PackageLoader("service.dashboard"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters.update(formats.FILTERS)
    made.globals.update(
        asset=assets.url,
        plotly_style_ids=assets.plotly_style_ids,
        parameter_name=words.parameter_name,
        parameter_meaning=words.parameter_meaning,
        observable_name=words.observable_name,
        strategy_meaning=words.strategy_meaning,
        place=place,
        word=words.look_up,
        words=words,
    )
    return made


def render(template: str, **context: Any) -> str:
    """The template as text."""
    return environment().get_template(template).render(**context)


def page(
    template: str, status: int = 200, headers: Mapping[str, str] | None = None, **context: Any
) -> Response:
    """A whole page."""
    return HTMLResponse(render(template, **context), status, {**HEADERS, **(headers or {})})


def problem_page(title: str, detail: str, status: int, headers: Mapping[str, str] | None = None) -> Response:
    """A page that says what is wrong and where to go."""
    return page("problem.html", status, headers, title=title, detail=detail)


def is_for_a_person(request: Request) -> bool:
    """Whether who asks is a browser that wants a page: programs do not prefer HTML, nor ask for it below /v1."""
    wanted = request.headers.get("accept", "").split(",")[0]
    return request.method == "GET" and "html" in wanted and not request.url.path.startswith("/v1/")


def unknown_address(request: Request) -> Response:
    """The page for an address that leads nowhere."""
    return problem_page("Not found", f"There is no page {request.url.path[:80]}.", NotFound.status)


def _away(what: str, sentence: str) -> Response:
    wait = {"Retry-After": str(Unavailable.retry_after_s)}
    detail = f"{sentence}. Jobs that run go on; this page comes back with it."
    return problem_page(f"{what} away", detail, Unavailable.status, wait)


class PageRoute(APIRoute):
    """A route whose errors are pages for a person, not JSON for a program."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        answer = super().get_route_handler()

        async def answer_or_explain(request: Request) -> Response:
            try:
                return await answer(request)
            except NotFound as error:
                return problem_page("Not found", error.detail, error.status)
            except (OperationalError, InterfaceError, PoolTimeout):
                return _away("Database", "The database does not answer")
            except StoreAway:
                return _away("Files", "The store of files does not answer")

        return answer_or_explain

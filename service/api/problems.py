"""Every error as problem+json: what handlers answer, and what the OpenAPI document says about it."""

from __future__ import annotations

import http
from collections.abc import Sequence
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from pydantic import BaseModel, Field
from sqlalchemy.exc import DBAPIError, InterfaceError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from starlette.exceptions import HTTPException

from service.api.safe_headers import add_safe_headers
from service.domain.errors import InvalidValue
from service.domain.states import ActionNotAllowed
from service.errors import (
    MEDIA_TYPE,
    Conflict,
    FieldError,
    InvalidRequest,
    MethodNotAllowed,
    Problem,
    Unauthorized,
    Unavailable,
)
from service.file_store import StoreAway

# What pydantic calls an error -> what is allowed instead. Ranges are the domain's, not pydantic's.
ALLOWED = {
    "missing": "required",
    "extra_forbidden": "no such field",
    "finite_number": "a finite number",
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "int_parsing": "a whole number",
    "string_type": "a text",
    "bool_type": "true or false",
    "list_type": "a list",
    "dict_type": "an object",
    "model_type": "an object",
    "model_attributes_type": "an object",
    "json_invalid": "valid JSON",
    "uuid_parsing": "a job's id (UUID)",
}


class FieldErrorBody(BaseModel):
    """One refused field."""

    field: str = Field(examples=["objective.target_deg"])
    value: Any = Field(examples=[95.0])
    allowed: str = Field(examples=["5 to 60 degrees"])


class ProblemBody(BaseModel):
    """Problem details (RFC 9457). `detail` is a sentence for a person; `errors` names each refused field."""

    type: str = Field(examples=["about:blank"])
    title: str = Field(examples=["Invalid request"])
    status: int = Field(examples=[422])
    detail: str = Field(examples=["objective.target_deg: got 95.0, allowed is 5 to 60 degrees"])
    errors: list[FieldErrorBody] | None = None


def problem_responses(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """The `responses` of a route that may answer with these statuses, and with those that every route may."""
    content = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/ProblemBody"}}}
    return {
        status: {"description": http.HTTPStatus(status).phrase, "content": content}
        for status in sorted({*statuses, 401, 403, 503})
    }


def install_handlers(app: FastAPI) -> None:
    """Make `app` answer every error as problem+json."""
    app.add_exception_handler(Problem, _problem)
    app.add_exception_handler(InvalidValue, _invalid_value)
    app.add_exception_handler(ActionNotAllowed, _not_now)
    app.add_exception_handler(RequestValidationError, _invalid_request)
    app.add_exception_handler(HTTPException, http_error)
    for kind in (OperationalError, InterfaceError, PoolTimeout):
        app.add_exception_handler(kind, _database_away)
    app.add_exception_handler(StoreAway, _store_away)
    app.add_exception_handler(DBAPIError, _database_error)
    app.add_exception_handler(Exception, _internal_error)


def problem_response(problem: Problem) -> JSONResponse:
    """The answer that tells of `problem`."""
    headers = {"Retry-After": str(problem.retry_after_s)} if problem.retry_after_s is not None else {}
    if isinstance(problem, Unauthorized):
        headers["WWW-Authenticate"] = "Bearer"
    if isinstance(problem, MethodNotAllowed):
        headers["Allow"] = problem.allowed
    return JSONResponse(problem.body(), problem.status, headers, MEDIA_TYPE)


def _problem(_request: Request, error: Exception) -> Response:
    assert isinstance(error, Problem)
    return problem_response(error)


def _invalid_value(_request: Request, error: Exception) -> Response:
    assert isinstance(error, InvalidValue)
    return problem_response(InvalidRequest.of(FieldError(error.field, error.value, error.allowed)))


def _not_now(_request: Request, error: Exception) -> Response:
    text = str(error)
    return problem_response(Conflict(f"{text[:1].upper()}{text[1:]}."))


def _invalid_request(_request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    return problem_response(InvalidRequest.of(*field_errors(error.errors())))


def field_errors(errors: Sequence[Any]) -> list[FieldError]:
    """pydantic's errors in our three words: field, value, allowed."""
    found = []
    for error in errors:
        place = [str(part) for part in error["loc"]]
        if error["type"] == "json_invalid":
            found.append(FieldError("body", "text that is not JSON", f"valid JSON ({error['ctx']['error']})"))
            continue
        cause = (error.get("ctx") or {}).get("error")
        if isinstance(cause, InvalidValue):
            found.append(FieldError(cause.field, cause.value, cause.allowed))
            continue
        field = ".".join(place[1:]) if len(place) > 1 else place[0]
        value = None if error["type"] == "missing" else error.get("input")
        found.append(FieldError(field, value, ALLOWED.get(error["type"], error["msg"])))
    return found


def http_error(_request: Request, error: Exception) -> Response:
    """What the framework refuses: an address or a method that is not there, a body that is no text."""
    assert isinstance(error, HTTPException)
    if error.status_code in (204, 304):
        return Response(status_code=error.status_code, headers=error.headers)
    if error.status_code == 400:
        # FastAPI's answer to a body that it cannot even read as text.
        return problem_response(
            InvalidRequest.of(FieldError("body", "unreadable bytes", "valid JSON in UTF-8"))
        )
    content = {
        "type": "about:blank",
        "title": http.HTTPStatus(error.status_code).phrase,
        "status": error.status_code,
        "detail": str(error.detail),
    }
    return JSONResponse(content, error.status_code, error.headers, MEDIA_TYPE)


def database_away() -> Response:
    """The answer while the database cannot be reached. The reason is for the log: it may hold its address."""
    return problem_response(Unavailable("The database cannot be reached; nothing was stored. Try again."))


def _database_away(_request: Request, _error: Exception) -> Response:
    return database_away()


def _store_away(_request: Request, _error: Exception) -> Response:
    return problem_response(Unavailable("The store of files cannot be reached; nothing was stored."))


def _database_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, DBAPIError)
    if error.connection_invalidated:
        return database_away()
    return _internal_error(request, error)


def _internal_error(_request: Request, _error: Exception) -> Response:
    answer = problem_response(Problem("Something went wrong inside the service; its log has the details."))
    add_safe_headers(answer.headers)  # it is answered outside of every middleware
    return answer

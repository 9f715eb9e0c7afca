"""The errors that the service answers with, each with its HTTP status: RFC 9457 problem details."""

from __future__ import annotations

import reprlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

MEDIA_TYPE = "application/problem+json"

# What is echoed of a refused value: enough to recognise it, never a whole upload.
LONGEST_ECHO = 200

# repr() of what nests as deep as a JSON text may is a RecursionError, and of a whole upload a second upload.
_BRIEF = reprlib.Repr()
_BRIEF.maxlevel = 6
_BRIEF.maxlist = _BRIEF.maxdict = _BRIEF.maxtuple = 40
_BRIEF.maxstring = _BRIEF.maxother = _BRIEF.maxlong = LONGEST_ECHO


@dataclass(frozen=True)
class FieldError:
    """One refused field: where it stands in the request, what was sent, and what is allowed."""

    field: str
    value: Any
    allowed: str

    def sentence(self) -> str:
        return f"{_shortened(self.field)}: got {_shortened(brief(self.value))}, allowed is {self.allowed}"

    def as_dict(self) -> dict[str, Any]:
        # A name, too, may be whatever the client called it.
        return {
            "field": _shortened(self.field),
            "value": echoed(self.value),
            "allowed": _sendable(self.allowed),
        }


def echoed(value: Any) -> Any:
    """`value` where it is a small plain JSON value, else a short text of it."""
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, int) and abs(value) < 2**53:
        return value
    if isinstance(value, float) and value == value and abs(value) != float("inf"):
        return value
    return _shortened(value if isinstance(value, str) else brief(value))


def brief(value: Any) -> str:
    """repr(), in bounded time, depth and length."""
    return _BRIEF.repr(value)


def _shortened(text: str) -> str:
    return _sendable(text if len(text) <= LONGEST_ECHO else text[: LONGEST_ECHO - 3] + "...")


def _sendable(text: str) -> str:
    # A lone surrogate is valid in a JSON string literal and cannot be encoded in the answer.
    return text.encode("utf-8", "replace").decode("utf-8")


class Problem(Exception):
    """A refusal or a failure that a client is told about."""

    status: ClassVar[int] = 500
    title: ClassVar[str] = "Internal error"
    retry_after_s: ClassVar[int | None] = None

    def __init__(self, detail: str, errors: Sequence[FieldError] = ()) -> None:
        super().__init__(detail)
        self.detail = detail
        self.errors = tuple(errors)

    def body(self) -> dict[str, Any]:
        content: dict[str, Any] = {
            "type": "about:blank",
            "title": self.title,
            "status": self.status,
            "detail": _sendable(self.detail),
        }
        if self.errors:
            content["errors"] = [error.as_dict() for error in self.errors]
        return content


class InvalidRequest(Problem):
    """Something in the request is not allowed; `errors` names each field, value and limit."""

    status = 422
    title = "Invalid request"

    @classmethod
    def of(cls, *errors: FieldError) -> InvalidRequest:
        return cls("; ".join(error.sentence() for error in errors[:5]), errors)


class Unauthorized(Problem):
    """No key, or one that is not (any more) known."""

    status = 401
    title = "Key needed"


class Forbidden(Problem):
    """The key's scope does not include this, or another site's page asks."""

    status = 403
    title = "Not allowed"


class NotFound(Problem):
    """No row has the asked-for id."""

    status = 404
    title = "Not found"


class MethodNotAllowed(Problem):
    """The address exists, and does not take this method."""

    status = 405
    title = "Method not allowed"

    def __init__(self, method: str, allowed: Sequence[str]) -> None:
        self.allowed = ", ".join(allowed)
        super().__init__(f"{method} is not taken here, allowed is {self.allowed}.")


class Conflict(Problem):
    """The row is in a state that does not allow this."""

    status = 409
    title = "Conflict"


class Unavailable(Problem):
    """The database, or the store of files, cannot be reached; nothing was stored."""

    status = 503
    title = "Service unavailable"
    retry_after_s = 5

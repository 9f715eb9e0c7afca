"""Liveness and readiness, with reasons."""

from __future__ import annotations

from fastapi import APIRouter, Response
from sqlalchemy.exc import DBAPIError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from sqlalchemy.orm import Session

from service.api.dependencies import DatabaseDep
from service.api.views import Check, Liveness, Readiness
from service.db import migrate, read_models
from service.errors import Unavailable

router = APIRouter(prefix="/v1/health", tags=["health"])

# Workers and dispatchers report every few seconds; after this long without, they count as gone.
SILENCE_S = 15.0


@router.get("/live", operation_id="isLive")
def live() -> Liveness:
    """The process answers; nothing else is looked at."""
    return Liveness()


@router.get(
    "/ready",
    operation_id="isReady",
    responses={503: {"model": Readiness, "description": "A required check failed"}},
)
def ready(response: Response, database: DatabaseDep) -> Readiness:
    """Whether requests can be answered. A missing worker or broker only delays jobs: no reason for 503."""
    try:
        with database.reading() as session:
            checks = {"database": Check(ok=True, required=True, reason=None), **_checks(session)}
    except (DBAPIError, PoolTimeout) as error:
        reason = f"the database does not answer ({type(error).__name__})"
        checks = {"database": Check(ok=False, required=True, reason=reason)}
    readiness = Readiness(ready=all(c.ok for c in checks.values() if c.required), checks=checks)
    if not readiness.ready:
        response.status_code = Unavailable.status
        response.headers["Retry-After"] = str(Unavailable.retry_after_s)
    return readiness


def _checks(session: Session) -> dict[str, Check]:
    wanted, found = migrate.newest_revision(), migrate.current_revision(session)
    if found != wanted:
        reason = f"the database has schema {found or 'none'}, this code needs {wanted}"
        return {"schema": Check(ok=False, required=True, reason=reason)}
    dispatchers = read_models.seen_lately(session, "dispatcher", SILENCE_S)
    workers = read_models.seen_lately(session, "worker", SILENCE_S)
    problems = [row.problem for row in dispatchers if row.problem]
    return {
        "schema": Check(ok=True, required=True, reason=None),
        "dispatcher": _optional(None if dispatchers else f"no dispatcher was seen for {SILENCE_S:g} s"),
        "broker": _optional(
            problems[0] if problems else None if dispatchers else "no dispatcher looks at it"
        ),
        "workers": _optional(None if workers else f"no worker was seen for {SILENCE_S:g} s"),
    }


def _optional(reason: str | None) -> Check:
    return Check(ok=reason is None, required=False, reason=reason)

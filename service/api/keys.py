"""Keys of the API: for whoever has the scope `admin`."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Self

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field

from service.api.dependencies import DatabaseDep, IdCursor, Limit, RowId
from service.api.problems import problem_responses
from service.api.views import as_utc
from service.db.access_reads import list_keys
from service.db.models import ApiKeyRow
from service.domain.access import DEFAULT_PROJECT, Scope
from service.errors import NotFound
from service.studies.manage_keys import create_key, revoke_key

router = APIRouter(prefix="/v1/keys", tags=["keys"])


class KeyBody(BaseModel):
    """A key to be made."""

    model_config = ConfigDict(extra="forbid")

    name: Annotated[str, Field(description="whom or what it is for", examples=["grafana"])]
    scope: Annotated[Scope, Field(description="read: look; run: ask for work too; admin: keys too")] = (
        Scope.RUN
    )
    project: Annotated[str, Field(description="what it makes and sees; made by its first key")] = (
        DEFAULT_PROJECT
    )


class KeyAnswer(BaseModel):
    """A key, without its secret."""

    id: int
    name: str
    prefix: str
    scope: Scope
    project: str
    created_at: datetime | None
    revoked_at: datetime | None

    @classmethod
    def of(cls, row: ApiKeyRow) -> Self:
        times = {"created_at": as_utc(row.created_at), "revoked_at": as_utc(row.revoked_at)}
        plain = {name: getattr(row, name) for name in ("id", "name", "prefix", "scope", "project")}
        return cls(**plain, **times)


class NewKeyAnswer(BaseModel):
    """A new key: `key` is shown here and never again."""

    key: str
    about: KeyAnswer


class KeyList(BaseModel):
    """Keys, newest first."""

    items: list[KeyAnswer]
    next_cursor: int | None


@router.post("", status_code=201, operation_id="createKey", responses=problem_responses(422))
def post_key(body: KeyBody, database: DatabaseDep) -> NewKeyAnswer:
    """Make a key."""
    with database.writing() as session:
        row, key = create_key(session, body.name, body.scope, body.project)
        return NewKeyAnswer(key=key.text, about=KeyAnswer.of(row))


@router.get("", operation_id="listKeys", responses=problem_responses(422))
def get_keys(database: DatabaseDep, limit: Limit = 50, cursor: IdCursor = None) -> KeyList:
    """All keys of the installation, revoked ones too."""
    with database.reading() as session:
        rows = list_keys(session, limit + 1, cursor)
        items = [KeyAnswer.of(row) for row in rows[:limit]]
    return KeyList(items=items, next_cursor=items[-1].id if len(rows) > limit else None)


@router.post("/{key_id}/revoke", operation_id="revokeKey", responses=problem_responses(404, 422))
def post_revoke(key_id: RowId, database: DatabaseDep) -> KeyAnswer:
    """Take a key back; with it end the sessions that it opened. Twice is as once."""
    with database.writing() as session:
        row = revoke_key(session, key_id)
        if row is None:
            raise NotFound(f"There is no key {key_id}.")
        return KeyAnswer.of(row)

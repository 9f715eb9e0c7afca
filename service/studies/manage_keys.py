"""Make keys and take them back."""

from __future__ import annotations

from sqlalchemy.orm import Session

from service.db import queries
from service.db.access_reads import has_keys
from service.db.models import ApiKeyRow
from service.domain.access import DEFAULT_PROJECT, NewKey, Scope, check_project, new_key
from service.domain.errors import InvalidValue

LONGEST_NAME = 100


def create_key(session: Session, name: str, scope: Scope, project: str) -> tuple[ApiKeyRow, NewKey]:
    """The row, and the key with its secret, which is shown now and never again. Raises InvalidValue."""
    if not 1 <= len(name.strip()) <= LONGEST_NAME or not name.isprintable():
        raise InvalidValue("name", name, f"1 to {LONGEST_NAME} printable characters")
    key = new_key()
    row = ApiKeyRow(
        name=name.strip(),
        prefix=key.prefix,
        secret_hash=key.secret_hash,
        scope=scope,
        project=check_project(project),
    )
    session.add(row)
    session.flush()
    session.refresh(row)
    return row, key


def create_first_key(session: Session) -> NewKey | None:
    """An admin's key for an installation that never had one; None where there was one."""
    if has_keys(session):
        return None
    return create_key(session, "first key", Scope.ADMIN, DEFAULT_PROJECT)[1]


def revoke_key(session: Session, key_id: int) -> ApiKeyRow | None:
    """None: no such key. Twice is as once."""
    row = session.get(ApiKeyRow, key_id, with_for_update=True)
    if row is not None and row.revoked_at is None:
        row.revoked_at = queries.now(session)
        session.flush()
    return row

"""What is read of keys."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from service.db.models import ApiKeyRow


def find_key(session: Session, prefix: str) -> ApiKeyRow | None:
    """The key of that prefix, unless it was revoked."""
    statement = select(ApiKeyRow).where(ApiKeyRow.prefix == prefix, ApiKeyRow.revoked_at.is_(None))
    return session.scalars(statement).one_or_none()


def list_keys(session: Session, limit: int, before: int | None) -> Sequence[ApiKeyRow]:
    """Newest first."""
    statement = select(ApiKeyRow).order_by(ApiKeyRow.id.desc()).limit(limit)
    if before is not None:
        statement = statement.where(ApiKeyRow.id < before)
    return session.scalars(statement).all()


def has_keys(session: Session) -> bool:
    """Whether there ever was one."""
    return bool(session.scalar(select(func.count()).select_from(ApiKeyRow)))

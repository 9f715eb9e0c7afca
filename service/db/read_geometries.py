"""Uploaded meshes, as the API and the dashboard show them."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.models import GeometryRow


def list_geometries(session: Session, limit: int, before: int | None = None) -> Sequence[GeometryRow]:
    """Newest first; `before` is the last id of the page that came before."""
    statement = select(GeometryRow).order_by(GeometryRow.id.desc()).limit(limit)
    if before is not None:
        statement = statement.where(GeometryRow.id < before)
    return session.scalars(statement).all()

"""The tables of charges: what was asked for and what came out, and the meshes that stand for parts of a plant."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Index, String, Text, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from service.db.base import Base, Id, OfProject, stored_enum
from service.db.clock import database_now
from service.domain.states import DesignState


class ChargeRow(OfProject, Base):
    """One charge of the hopper: one seed, one set of contact numbers.

    `series`: the id of the first charge that the same request asked for; that row keeps the request's key. `cost`:
    what it was expected to take; `results`: the summary with its findings, without what the inputs repeat.
    """

    __tablename__ = "charges"
    __table_args__ = (
        UniqueConstraint("idempotency_key", "project"),
        Index("ix_charges_series", "series"),
        {"sqlite_autoincrement": True},
    )

    id: Mapped[int] = mapped_column(Id, primary_key=True)
    series: Mapped[int]
    state: Mapped[DesignState] = mapped_column(stored_enum(DesignState, "state"), default=DesignState.WAITING)
    charge: Mapped[str] = mapped_column(String(64))
    scale: Mapped[float]
    seed: Mapped[int]
    spec: Mapped[dict[str, Any]]
    cost: Mapped[dict[str, Any]]
    results: Mapped[dict[str, Any] | None]
    failure_class: Mapped[str | None] = mapped_column(String(32))
    failure_text: Mapped[str | None] = mapped_column(Text)
    code_version: Mapped[str | None] = mapped_column(String(64))
    idempotency_key: Mapped[str | None] = mapped_column(String(200))
    request_hash: Mapped[str | None] = mapped_column(String(64))
    created_at: Mapped[float] = mapped_column(default=database_now())
    started_at: Mapped[float | None]
    ended_at: Mapped[float | None]


class GeometryRow(OfProject, Base):
    """An uploaded mesh; `path` (below the geometry folder) never leaves the service."""

    __tablename__ = "geometries"
    __table_args__ = (UniqueConstraint("sha256", "project"), {"sqlite_autoincrement": True})

    id: Mapped[int] = mapped_column(Id, primary_key=True)
    file_name: Mapped[str] = mapped_column(String(100))
    sha256: Mapped[str] = mapped_column(String(64))
    size_bytes: Mapped[int]
    triangles: Mapped[int]
    extent: Mapped[dict[str, Any]]
    path: Mapped[str] = mapped_column(String(200))
    created_at: Mapped[float] = mapped_column(default=database_now())

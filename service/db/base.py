"""What every table shares: the metadata, the type of keys, and enums that the database checks."""

from __future__ import annotations

import enum
from typing import Any, ClassVar

from sqlalchemy import JSON, BigInteger, Double, Enum, Integer, MetaData, String
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

from service.domain.access import DEFAULT_PROJECT

# SQLite only numbers rows by itself in a column of type INTEGER.
Id = BigInteger().with_variant(Integer(), "sqlite")


class Base(DeclarativeBase):
    """All tables, with constraint names that a later migration can address on both databases."""

    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(column_0_label)s",
            "uq": "uq_%(table_name)s_%(column_0_name)s",
            "ck": "ck_%(table_name)s_%(constraint_name)s",
            "fk": "fk_%(table_name)s_%(column_0_name)s_%(referred_table_name)s",
            "pk": "pk_%(table_name)s",
        }
    )
    type_annotation_map: ClassVar[dict[Any, Any]] = {
        dict[str, Any]: JSON(none_as_null=True),
        float: Double(),
        int: BigInteger(),
    }


def stored_enum(states: type[enum.Enum], name: str) -> Enum:
    """A text column that takes the enum's values only; a CHECK says so to the database, too."""
    return Enum(
        states,
        name=name,
        native_enum=False,
        create_constraint=True,
        length=16,
        values_callable=lambda members: [m.value for m in members],
    )


class OfProject:
    """A column for whoever may see the row: `visibility` keeps the projects apart."""

    project: Mapped[str] = mapped_column(
        String(32), default=DEFAULT_PROJECT, server_default=DEFAULT_PROJECT, nullable=False
    )

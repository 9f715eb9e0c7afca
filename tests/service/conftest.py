"""The databases that these tests run on."""

from tests.builders.databases import (
    database,
    migrated_sqlite,
    postgres,
    postgres_database,
    sqlite_database,
)
from tests.builders.web import client, settings

__all__ = [
    "client",
    "database",
    "migrated_sqlite",
    "postgres",
    "postgres_database",
    "settings",
    "sqlite_database",
]

"""The databases that these tests run on."""

from tests.builders.databases import (
    database,
    migrated_sqlite,
    postgres,
    postgres_database,
    sqlite_database,
)

__all__ = ["database", "migrated_sqlite", "postgres", "postgres_database", "sqlite_database"]

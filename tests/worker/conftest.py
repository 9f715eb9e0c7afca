"""The databases that these tests run on, and a worker process that lives in the test's own."""

from tests.builders.databases import (
    database,
    migrated_sqlite,
    postgres,
    postgres_database,
    sqlite_database,
)
from tests.builders.work import settings, worker

__all__ = [
    "database",
    "migrated_sqlite",
    "postgres",
    "postgres_database",
    "settings",
    "sqlite_database",
    "worker",
]

"""The settings and the database of this worker process."""

from __future__ import annotations

import os
from functools import lru_cache

from service.db.session import Database
from service.settings import Settings, get_settings


def settings() -> Settings:
    """This process's settings."""
    return get_settings()


def database() -> Database:
    """This process's database. A forked child gets its own: connections do not survive a fork."""
    return _database_of(os.getpid(), settings().resolved_database_url)


@lru_cache(maxsize=1)
def _database_of(_pid: int, url: str) -> Database:
    return Database(url)

"""A client of the API over an empty database."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from service.app import create_app
from service.db.session import Database
from service.settings import Settings


@pytest.fixture
def settings(tmp_path: Path, sqlite_database: Database) -> Settings:
    return Settings(data_dir=tmp_path, database_url=sqlite_database.url)


@pytest.fixture
def client(settings: Settings) -> Iterator[TestClient]:
    """Errors inside the service come as answers, as a real client gets them."""
    with TestClient(create_app(settings), raise_server_exceptions=False) as found:
        yield found

"""One Database per process: engine, and transactions for writing and for reading.

SQLite begins a writing transaction with BEGIN IMMEDIATE. A plain BEGIN takes the write lock only at the first
write, and then fails at once ("database is locked") when another writer came between, whatever the time-out.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, create_engine, event, make_url
from sqlalchemy.orm import Session

from service.db.clock import STEADY_CLOCK
from service.db.file_system import refuse_network_file_system
from service.db.visibility import restrict

# How long a statement waits for another writer, and a connection for the server; then the client gets a 503.
LOCK_TIMEOUT_S = 5.0

# As many as an API has threads for requests (anyio): with fewer, requests on a slow machine would wait for
# each other's connections, and then be told that the database is away.
KEPT_CONNECTIONS, MOST_CONNECTIONS = 5, 40
POOL: dict[str, Any] = {
    "pool_size": KEPT_CONNECTIONS,
    "max_overflow": MOST_CONNECTIONS - KEPT_CONNECTIONS,
    "pool_timeout": LOCK_TIMEOUT_S,
}

# Without, a server whose machine vanished is waited for as long as TCP likes: two hours.
NOTICES_A_DEAD_SERVER = {
    "keepalives": 1,
    "keepalives_idle": 5,
    "keepalives_interval": 2,
    "keepalives_count": 3,
    "tcp_user_timeout": 10_000,
}

READ_ONLY = "talus_read_only"


class Database:
    """Opens transactions on one database. Connects when first used; safe to share between threads."""

    def __init__(self, url: str, engine: Engine | None = None, project: str | None = None) -> None:
        self.url = url
        self.engine = engine or make_engine(url)
        self._project = project

    def within(self, project: str | None) -> Database:
        """The same database, of which only this project's rows are seen; None: all."""
        return Database(self.url, self.engine, project)

    @contextmanager
    def writing(self) -> Iterator[Session]:
        """A transaction that is committed at the end of the block, or rolled back by an exception."""
        with Session(self.engine, expire_on_commit=False) as session, session.begin():
            self._restrict(session)
            yield session

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """A consistent view that never waits for a writer on SQLite; nothing is committed."""
        connection = self.engine.connect().execution_options(**{READ_ONLY: True})
        with connection, Session(connection, expire_on_commit=False) as session:
            self._restrict(session)
            yield session

    def _restrict(self, session: Session) -> None:
        if self._project is not None:
            restrict(session, self._project)

    def dispose(self) -> None:
        """Close all connections, for instance before a fork."""
        self.engine.dispose()


def make_engine(url: str) -> Engine:
    """An engine with the service's rules: strict JSON, SQLite in WAL with foreign keys, bounded waits."""
    parsed = make_url(url)
    dumps = partial(json.dumps, allow_nan=False)
    if parsed.get_backend_name() == "sqlite":
        if parsed.database is None or parsed.database in ("", ":memory:"):
            raise ValueError("SQLite in memory is private to one connection; name a file")
        path = Path(parsed.database)
        path.parent.mkdir(parents=True, exist_ok=True)
        refuse_network_file_system(path)
        engine = create_engine(
            parsed, json_serializer=dumps, connect_args={"timeout": LOCK_TIMEOUT_S}, **POOL
        )
        event.listen(engine, "connect", _set_up_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
        return engine
    options = f"-c lock_timeout={int(LOCK_TIMEOUT_S * 1000)} -c statement_timeout=30000"
    return create_engine(
        parsed,
        json_serializer=dumps,
        pool_pre_ping=True,
        connect_args={"connect_timeout": int(LOCK_TIMEOUT_S), "options": options, **NOTICES_A_DEAD_SERVER},
        **POOL,
    )


def _set_up_sqlite(connection: Any, _record: Any) -> None:
    # Turns the driver's own BEGIN off: _begin_sqlite says which one.
    connection.isolation_level = None
    connection.create_function(STEADY_CLOCK, 0, time.monotonic)
    cursor = connection.cursor()
    cursor.execute("PRAGMA journal_mode=WAL")
    # FULL: a commit that was answered survives a power cut. NORMAL loses the last ones.
    cursor.execute("PRAGMA synchronous=FULL")
    cursor.execute("PRAGMA foreign_keys=ON")
    cursor.close()


def _begin_sqlite(connection: Connection) -> None:
    read_only = connection.get_execution_options().get(READ_ONLY, False)
    connection.exec_driver_sql("BEGIN" if read_only else "BEGIN IMMEDIATE")

"""The database's own clocks, in SQL: one that says what time it is, and one that leases are judged by.

A worker whose own clock is wrong can so neither steal nor keep a job. On PostgreSQL both are the server's.
SQLite has no server: its clock is that of whichever process asks. All of them are on one machine, so leases there
go by the machine's monotonic clock, which no process and no correction of the time moves.

`database_now` on SQLite: julianday, because unixepoch('subsec') is NULL before 3.42 (physical resolution 1 ms).
"""

from __future__ import annotations

from typing import Any

from sqlalchemy import Double
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.functions import FunctionElement

UNIX_EPOCH_JULIAN_DAY = 2440587.5
# The function that `session` registers with each connection to SQLite.
STEADY_CLOCK = "talus_steady_clock"


class database_now(FunctionElement[float]):  # noqa: N801 (reads as the SQL function that it is)
    """Seconds since 1970 by the database's clock when the statement runs, not when its transaction began."""

    type = Double()
    inherit_cache = True


@compiles(database_now, "sqlite")
def _sqlite(_element: Any, _compiler: Any, **_: Any) -> str:
    return f"((julianday('now') - {UNIX_EPOCH_JULIAN_DAY}) * 86400.0)"


@compiles(database_now, "postgresql")
def _postgresql(_element: Any, _compiler: Any, **_: Any) -> str:
    # now() would be the start of the transaction, which may have waited for a lock.
    return "extract(epoch from clock_timestamp())::double precision"


class lease_now(FunctionElement[float]):  # noqa: N801 (reads as the SQL function that it is)
    """Seconds by the clock that leases are judged by. On SQLite it starts anew with the machine."""

    type = Double()
    inherit_cache = True


@compiles(lease_now, "sqlite")
def _sqlite_lease(_element: Any, _compiler: Any, **_: Any) -> str:
    return f"{STEADY_CLOCK}()"


@compiles(lease_now, "postgresql")
def _postgresql_lease(element: Any, compiler: Any, **_: Any) -> str:
    return _postgresql(element, compiler)

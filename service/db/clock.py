"""The database's own clock, as seconds since 1970 (UTC), in SQL.

Leases and time-outs are judged by this one clock, so that a worker whose own clock is wrong cannot steal or
keep a job. SQLite: julianday, because unixepoch('subsec') is NULL before 3.42 (physical resolution 1 ms).
"""

from __future__ import annotations

from typing import Any

from sqlalchemy import Double
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.functions import FunctionElement

UNIX_EPOCH_JULIAN_DAY = 2440587.5


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

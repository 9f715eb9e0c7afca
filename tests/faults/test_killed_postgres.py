"""The rig's PostgreSQL under faults that overlap: they must not end a schedule for the rig's own sake."""

from __future__ import annotations

import psycopg

from tests.builders.postgres import running_postgres


def test_a_server_killed_twice_and_started_twice_answers() -> None:
    """The second kill meets a dead server, the second start one that runs."""
    with running_postgres() as server:
        server.kill()
        server.kill()
        server.start_again()
        server.start_again()
        with psycopg.connect(server.url().replace("+psycopg", ""), connect_timeout=5) as connection:
            assert connection.execute("select 1").fetchone() == (1,)

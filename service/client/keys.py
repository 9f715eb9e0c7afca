"""`talus keys`: for whoever may write to the installation's database; no key is needed for it.

What opens the database is imported by the commands: every other command would wait for SQLAlchemy at its start.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.table import Table

from service.domain.access import DEFAULT_PROJECT, Scope
from service.domain.errors import InvalidValue
from service.settings import get_settings

if TYPE_CHECKING:
    from sqlalchemy.orm import Session

MOST_LISTED = 1000


@contextmanager
def _writing() -> Iterator[Session]:
    from service.db.session import Database

    database = Database(get_settings().resolved_database_url)
    with database.writing() as session:
        yield session
    database.dispose()


@click.group("keys")
def keys_command() -> None:
    """Make, list and revoke keys of the API."""


@keys_command.command("create")
@click.argument("name")
@click.option(
    "--scope", type=click.Choice([scope.value for scope in Scope]), default="run", show_default=True
)
@click.option("--project", default=DEFAULT_PROJECT, show_default=True, help="what the key makes and sees")
def create(name: str, scope: str, project: str) -> None:
    """Make a key and print it, once."""
    from service.studies.manage_keys import create_key

    with _writing() as session:
        try:
            _, key = create_key(session, name, Scope(scope), project)
        except InvalidValue as error:
            raise click.BadParameter(
                f"{error.value!r}; allowed is {error.allowed}", param_hint=error.field
            ) from error
    click.echo(key.text)


@keys_command.command("list")
def show() -> None:
    """All keys, newest first."""
    from service.db.access_reads import list_keys

    table = Table("prefix", "name", "scope", "project", "made", "revoked")
    with _writing() as session:
        for row in list_keys(session, MOST_LISTED, None):
            table.add_row(
                row.prefix, row.name, row.scope.value, row.project, _day(row.created_at), _day(row.revoked_at)
            )
    Console().print(table)


@keys_command.command("revoke")
@click.argument("prefix")
def revoke(prefix: str) -> None:
    """Take a key back, and end the sessions that it opened."""
    from service.db.access_reads import find_key
    from service.studies.manage_keys import revoke_key

    with _writing() as session:
        row = find_key(session, prefix)
        if row is None:
            raise click.BadParameter(f"no valid key has the prefix {prefix!r}", param_hint="PREFIX")
        revoke_key(session, row.id)


def _day(seconds: float | None) -> str:
    return "" if seconds is None else datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M")

"""Brings a database to the newest schema, and says which one it has.

Alembic is imported when it is first used: the API needs it only once somebody asks whether it is ready.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from sqlalchemy.orm import Session

if TYPE_CHECKING:
    from alembic.config import Config

MIGRATIONS = Path(__file__).resolve().parents[2] / "migrations"


def configuration(url: str) -> Config:
    """Alembic's configuration for one database, without an alembic.ini."""
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS))
    # ConfigParser reads % as the start of a placeholder; an encoded password has some.
    config.set_main_option("sqlalchemy.url", url.replace("%", "%%"))
    return config


def upgrade(url: str, revision: str = "head") -> None:
    """From whatever schema is there (or none) up to `revision`. Does nothing where it is there already."""
    from alembic import command

    command.upgrade(configuration(url), revision)


def downgrade(url: str, revision: str) -> None:
    """Back to `revision` ("base": no tables)."""
    from alembic import command

    command.downgrade(configuration(url), revision)


@cache
def newest_revision() -> str | None:
    """The schema that this code needs; every migration's file is read for it, once."""
    from alembic.config import Config
    from alembic.script import ScriptDirectory

    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS))
    return ScriptDirectory.from_config(config).get_current_head()


def current_revision(session: Session) -> str | None:
    """The schema that the database has; None without any."""
    from alembic.runtime.migration import MigrationContext

    return MigrationContext.configure(session.connection()).get_current_revision()

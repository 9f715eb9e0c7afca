"""Alembic's entry: which database to change (the caller's, or the one of the service's settings)."""

from __future__ import annotations

from alembic import context
from sqlalchemy import event

from service.db.models import Base
from service.db.session import make_engine
from service.settings import get_settings


def run() -> None:
    """Run the wanted migrations in one transaction: a migration that fails leaves the old schema."""
    url = context.config.get_main_option("sqlalchemy.url") or get_settings().resolved_database_url
    engine = make_engine(url)
    if engine.dialect.name == "sqlite":
        # After the engine's own rules: a table that is made anew must not take along what refers to it.
        event.listen(engine, "connect", lambda raw, _record: raw.execute("PRAGMA foreign_keys=OFF").close())
    with engine.connect() as connection:
        context.configure(
            connection=connection,
            target_metadata=Base.metadata,
            compare_type=True,
            render_as_batch=connection.dialect.name == "sqlite",
        )
        with context.begin_transaction():
            context.run_migrations()
        connection.commit()
    engine.dispose()


if context.is_offline_mode():
    raise SystemExit("migrations run on a connection; --sql is not offered")
run()

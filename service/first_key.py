"""The first key of an installation: made at its first start, printed once."""

from __future__ import annotations

from service.settings import Settings


def first_key_lines(settings: Settings) -> list[str]:
    """What to print: the key of an installation that asks for keys and never had one; else nothing."""
    if not settings.asks_for_keys:
        return []
    # The supervisor of an installation that asks for no keys needs no database code at all.
    from service.db.session import Database
    from service.studies.manage_keys import create_first_key

    database = Database(settings.resolved_database_url)
    with database.writing() as session:
        key = create_first_key(session)
    database.dispose()
    if key is None:
        return []
    return [
        f"first key, scope admin, shown only now: {key.text}",
        "send it as `Authorization: Bearer KEY`, or set TALUS_API_KEY for the talus commands",
    ]

"""A browser's session: opened with a key, carried by a cookie, ended by its hour or with its key."""

from __future__ import annotations

import hashlib
import hmac
import time

from sqlalchemy.orm import Session

from service.db.access_reads import find_key
from service.db.models import ApiKeyRow
from service.domain.access import is_same, parse_key

LOGIN = "/login"
COOKIE = "talus_session"
SESSION_S = 12 * 3600


def key_of_text(session: Session, text: str) -> ApiKeyRow | None:
    """The row of a key as it was sent or typed; None for what is no valid key."""
    key = parse_key(text.strip())
    row = None if key is None else find_key(session, key.prefix)
    return row if key is not None and row is not None and is_same(row.secret_hash, key.secret) else None


def open_session(session: Session, text: str) -> str | None:
    """The cookie's value; None for what is no valid key."""
    row = key_of_text(session, text)
    return None if row is None else _proof(row, int(time.time()) + SESSION_S)


def key_of_session(session: Session, cookie: str) -> ApiKeyRow | None:
    """The key that the session was opened with, while both are valid."""
    parts = cookie.split(".")
    if len(parts) != 3 or not parts[1].isascii() or not parts[1].isdigit() or len(parts[1]) > 12:
        return None
    prefix, until = parts[0], int(parts[1])
    row = find_key(session, prefix) if len(prefix) <= 16 and until > time.time() else None
    if row is None:
        return None
    return row if hmac.compare_digest(cookie.encode(), _proof(row, until).encode()) else None


def _proof(row: ApiKeyRow, until: int) -> str:
    """Whose, until when, and what only this installation can have made of both."""
    said = f"{row.prefix}.{until}"
    return f"{said}.{hmac.new(row.secret_hash.encode(), said.encode(), hashlib.sha256).hexdigest()}"

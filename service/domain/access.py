"""Who may do what: keys, their scopes, and projects that do not see each other.

A key reads `talus_<prefix>_<secret>`. Of the secret only the SHA-256 is kept: it has 256 random bits, so a slow
hash would gain nothing.
"""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
from dataclasses import dataclass
from enum import Enum

from service.domain.errors import InvalidValue

DEFAULT_PROJECT = "default"
SECRET_BYTES = 32
PREFIX_BYTES = 4
_PROJECT = re.compile(r"[a-z0-9][a-z0-9-]{0,31}")
_KEY = re.compile(r"talus_([0-9a-f]{8})_([A-Za-z0-9_-]{43})")


class Scope(Enum):
    """What a key may do; each includes the one before: look, ask for work and stop it, manage keys."""

    READ = "read"
    RUN = "run"
    ADMIN = "admin"

    def includes(self, needed: Scope) -> bool:
        """True where a key of this scope may do what `needed` names."""
        order = list(Scope)
        return order.index(self) >= order.index(needed)


@dataclass(frozen=True)
class Principal:
    """Who asks: under which scope, and in which project. `prefix` names the key; None where none is asked for."""

    scope: Scope
    project: str | None
    prefix: str | None = None


@dataclass(frozen=True)
class NewKey:
    """A key at the one moment when its secret is known."""

    prefix: str
    secret: str

    @property
    def text(self) -> str:
        return f"talus_{self.prefix}_{self.secret}"

    @property
    def secret_hash(self) -> str:
        return hash_secret(self.secret)


def new_key() -> NewKey:
    """A key from the system's source of randomness."""
    return NewKey(secrets.token_hex(PREFIX_BYTES), secrets.token_urlsafe(SECRET_BYTES))


def parse_key(text: str) -> NewKey | None:
    """None: this is no key."""
    found = _KEY.fullmatch(text)
    return None if found is None else NewKey(found[1], found[2])


def hash_secret(secret: str) -> str:
    """What is stored of a secret."""
    return hashlib.sha256(secret.encode()).hexdigest()


def is_same(stored_hash: str, secret: str) -> bool:
    """Compared in constant time."""
    return hmac.compare_digest(stored_hash, hash_secret(secret))


def check_project(name: str) -> str:
    """`name`, or InvalidValue."""
    if not _PROJECT.fullmatch(name):
        raise InvalidValue("project", name, "1 to 32 of a-z, 0-9 and -, the first no -")
    return name

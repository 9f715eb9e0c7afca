"""Fixtures of the documentation's tests."""

from tests.builders.databases import migrated_sqlite

__all__ = ["migrated_sqlite"]

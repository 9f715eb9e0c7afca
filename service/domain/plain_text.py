"""Text that every database can keep and every answer can hold."""

from __future__ import annotations


def clean_text(text: str) -> str:
    """`text` itself. Raises ValueError: PostgreSQL stores no NUL, and nothing a half of a surrogate pair."""
    if "\x00" in text or any("\ud800" <= character <= "\udfff" for character in text):
        raise ValueError("a text without NUL characters and lone surrogates is needed")
    return text

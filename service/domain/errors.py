"""The one error of the domain: a value that is not allowed, with the three facts a user needs."""

from __future__ import annotations


class InvalidValue(ValueError):
    """`field` (dotted path as the client wrote it), `value` and `allowed` (a phrase) are for the user."""

    def __init__(self, field: str, value: object, allowed: str) -> None:
        super().__init__(f"{field}: got {value!r}, allowed is {allowed}")
        self.field = field
        self.value = value
        self.allowed = allowed

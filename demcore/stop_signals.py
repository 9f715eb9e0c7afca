"""Ctrl-C and SIGTERM, noted instead of raised.

Python raises KeyboardInterrupt wherever it is. Inside the callbacks of the compiler that is lost, and inside a
library's clean-up it leaves things half done; so a program that may compile notes the signal and asks later.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def stop_signals() -> Iterator[list[int]]:
    """Ctrl-C or SIGTERM fill the list, so that the run saves itself and ends; a second Ctrl-C ends it at once."""
    received: list[int] = []

    def note(number: int, _frame: object) -> None:
        if received:
            raise KeyboardInterrupt
        received.append(number)

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)

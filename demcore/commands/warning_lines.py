"""Warnings about checkpoints as a program tells them: one line each on stderr, without Python's source lines."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

from demcore.checkpoint import CheckpointWarning


@contextmanager
def checkpoint_warnings_as_lines() -> Iterator[None]:
    """Show every CheckpointWarning once, whoever looks at the file again; other warnings as usual."""
    told: set[str] = set()
    with warnings.catch_warnings():
        usual = warnings.showwarning

        def show(
            message: Warning | str,
            category: type[Warning],
            filename: str,
            lineno: int,
            file: TextIO | None = None,
            line: str | None = None,
        ) -> None:
            if not issubclass(category, CheckpointWarning):
                usual(message, category, filename, lineno, file, line)
            elif str(message) not in told:
                told.add(str(message))
                print(f"warning: {message}", file=sys.stderr)

        warnings.simplefilter("always", CheckpointWarning)
        warnings.showwarning = show
        yield

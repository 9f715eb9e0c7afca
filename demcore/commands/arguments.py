"""The command line's own checks: what argparse refuses is one line too, and a folder is made last of all."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

from demcore.errors import InputError


class UsageError(ValueError):
    """Arguments that argparse does not understand; the text is its message."""


class Parser(argparse.ArgumentParser):
    """A parser that raises UsageError where argparse would print its usage and exit."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(message)


def check_at_least(field: str, value: float, least: float) -> None:
    """Raises InputError for less, and for what is no number."""
    if not value >= least:
        raise InputError(field, value, f"{least:g} or more")


@contextmanager
def output_folder(path: Path) -> Iterator[Path]:
    """`path` as a folder to write to, made if need be; made folders go again when the input proves wrong.

    Raises InputError when it cannot be one.
    """
    missing = []
    place = path.absolute()
    while not place.exists():
        missing.append(place)
        place = place.parent
    if not place.is_dir():
        raise InputError("out", str(path), f"a folder: {place} is a file")
    if not os.access(place, os.W_OK | os.X_OK):
        raise InputError("out", str(path), f"a folder that can be written to, unlike {place}")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError("out", str(path), f"a folder that can be written to ({error.strerror})") from None
    try:
        yield path
    except InputError:
        for made in missing:
            # Only what is empty: rmdir refuses anything else.
            if not any(made.iterdir()):
                made.rmdir()
        raise

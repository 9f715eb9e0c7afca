"""Checkpoints: one file with every array and number of a run, written so that a crash never leaves half a one.

Write aside, fsync, rename, fsync the folder; the file before it is kept. A file carries the sha256 of its
content, so that a truncated or altered one is refused.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAGIC = b"TALUS-CHECKPOINT-1\n"
PREVIOUS = ".previous"


class BadCheckpoint(ValueError):
    """The file is truncated, altered, or of another kind; the text says which file."""


def save(path: Path, numbers: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
    """Write a checkpoint; `numbers` is JSON-able, arrays keep their dtype and bits."""
    buffer = io.BytesIO()
    text = np.frombuffer(json.dumps(numbers).encode(), np.uint8)
    np.savez(buffer, allow_pickle=False, **{"__numbers__": text, **arrays})
    content = buffer.getvalue()
    aside = path.with_name(path.name + ".part")
    with open(aside, "wb") as file:
        file.write(MAGIC + hashlib.sha256(content).hexdigest().encode() + b"\n" + content)
        file.flush()
        os.fsync(file.fileno())
    if path.exists():
        os.replace(path, path.with_name(path.name + PREVIOUS))
    os.replace(aside, path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def load(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Read a checkpoint. Raises BadCheckpoint when the file is not whole, FileNotFoundError when absent."""
    raw = path.read_bytes()
    head = len(MAGIC) + 65
    if not raw.startswith(MAGIC) or len(raw) < head:
        raise BadCheckpoint(f"{path.name} is not a Talus checkpoint or is truncated")
    content = raw[head:]
    if hashlib.sha256(content).hexdigest().encode() != raw[len(MAGIC) : head - 1]:
        raise BadCheckpoint(f"{path.name} is truncated or altered: its checksum does not fit")
    with np.load(io.BytesIO(content), allow_pickle=False) as stored:
        arrays = {name: stored[name] for name in stored.files if name != "__numbers__"}
        numbers = json.loads(stored["__numbers__"].tobytes())
    return numbers, arrays


def load_newest(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]] | None:
    """The newest whole checkpoint of `path` and the one before it; None when there is none."""
    for candidate in (path, path.with_name(path.name + PREVIOUS)):
        try:
            return load(candidate)
        except (FileNotFoundError, BadCheckpoint):
            continue
    return None


def discard(path: Path) -> None:
    """Remove a finished run's checkpoints."""
    for candidate in (path, path.with_name(path.name + PREVIOUS), path.with_name(path.name + ".part")):
        candidate.unlink(missing_ok=True)

"""Checkpoints: one file with every array and number of a run, written so that a crash never leaves half a one.

Write aside, fsync, rename, fsync the folder; the file before it is kept. A file carries the sha256 of its
content, so that a truncated or altered one is refused.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

MAGIC = b"TALUS-CHECKPOINT-2\n"
PREVIOUS = ".previous"

Record = TypeVar("Record")


class BadCheckpoint(ValueError):
    """The file is truncated, altered, or of another kind; the text says which file."""


class CheckpointWarning(UserWarning):
    """A checkpoint that is there was not used; the text says which file and why."""


def flat(prefix: str, record: Any) -> dict[str, NDArray[Any]]:
    """The arrays of a NamedTuple, NamedTuples inside it included, under names that start with `prefix`."""
    arrays: dict[str, NDArray[Any]] = {}
    for name, value in record._asdict().items():
        key = f"{prefix}_{name}"
        arrays |= flat(key, value) if hasattr(value, "_asdict") else {key: np.asarray(value)}
    return arrays


def rebuilt(prefix: str, template: Record, arrays: Mapping[str, NDArray[Any]]) -> Record:
    """A NamedTuple of the template's kind from the arrays that `flat` wrote."""
    kind: Any = type(template)
    fields: dict[str, Any] = template._asdict()  # type: ignore[attr-defined]
    values = {}
    for name, value in fields.items():
        key = f"{prefix}_{name}"
        values[name] = rebuilt(key, value, arrays) if hasattr(value, "_asdict") else arrays[key]
    built: Record = kind(**values)
    return built


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


def load_newest(
    path: Path, identity: str | None = None
) -> tuple[dict[str, Any], dict[str, NDArray[Any]]] | None:
    """The newest whole checkpoint of `path` and the one before it; None when there is none.

    With `identity`, one of another case or of other code is passed over. A file that is there and is not used
    is named in a CheckpointWarning.
    """
    for candidate in (path, path.with_name(path.name + PREVIOUS)):
        try:
            numbers, arrays = load(candidate)
        except FileNotFoundError:
            continue
        except BadCheckpoint as error:
            warnings.warn(f"checkpoint refused: {error}", CheckpointWarning, stacklevel=2)
            continue
        if identity is None or numbers.get("identity") == identity:
            return numbers, arrays
        warnings.warn(
            f"checkpoint refused: {candidate.name} is of another case or of other code",
            CheckpointWarning,
            stacklevel=2,
        )
    return None


def discard(path: Path) -> None:
    """Remove a finished run's checkpoints."""
    for candidate in (path, path.with_name(path.name + PREVIOUS), path.with_name(path.name + ".part")):
        candidate.unlink(missing_ok=True)

"""One hash that says which case a file belongs to: every value of a record, exactly."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from demcore.source_hash import hash_sources


def plain(value: Any) -> Any:
    """A record as JSON-able data: dataclasses by class and field, arrays by shape, type and content's hash.

    Floats go through repr, which Python writes so that the same bits come back.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return {"class": type(value).__name__, **fields}
    if isinstance(value, np.ndarray):
        content = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        return {"shape": list(value.shape), "dtype": str(value.dtype), "sha256": content}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    if isinstance(value, Path):
        return value.as_posix()
    if value is None or isinstance(value, str | int | float | bool):
        return value
    raise TypeError(f"a case holds plain data, not {type(value).__name__}")


def run_identity(case: Any, program: Any = None) -> str:
    """Of a run of a case, whose outcome may depend on a program's own data too."""
    return identity((case, program))


def identity(record: Any) -> str:
    """sha256 over a record and over demcore's own sources: other code may give other bits."""
    text = json.dumps(plain(record), sort_keys=True)
    return hashlib.sha256(f"{_own_sources()}\n{text}".encode()).hexdigest()


@cache
def _own_sources() -> str:
    """Once in a process: the code that runs is the code that was loaded."""
    return hash_sources(Path(__file__).parent)

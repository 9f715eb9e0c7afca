"""Which simulation code this is: one hash over every source and data file of demcore.

It is stored with every result, so that a number can be traced to the code behind it. Compiled kernels are
kept under a hash of their own, see demcore/jit.py.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

SOURCE_SUFFIXES = (".py", ".toml")


def hash_sources(package: Path) -> str:
    """sha256 over the relative path and content of every source file below `package`, in sorted order."""
    total = hashlib.sha256()
    for path in sorted(p for p in package.rglob("*") if p.suffix in SOURCE_SUFFIXES and p.is_file()):
        for part in (path.relative_to(package).as_posix().encode(), path.read_bytes()):
            total.update(len(part).to_bytes(8, "big"))
            total.update(part)
    return total.hexdigest()


def demcore_folder() -> Path:
    """The folder of the demcore that this process would import."""
    spec = find_spec("demcore")
    assert spec is not None and spec.submodule_search_locations is not None, "demcore is part of the install"
    return Path(next(iter(spec.submodule_search_locations)))


@lru_cache(maxsize=1)
def demcore_hash() -> str:
    """The hash of that demcore."""
    return hash_sources(demcore_folder())

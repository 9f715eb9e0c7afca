"""Which code this is: one hash over the sources and data files of a package. Importable without numba.

Numba's cache folder and the code version that is stored with every result are named by it.
"""

from __future__ import annotations

import hashlib
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

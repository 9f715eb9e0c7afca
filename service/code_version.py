"""Which simulation code this is: one hash over every source and data file of demcore.

It is stored with every result, so that a number can be traced to the code behind it. Compiled kernels are
kept under a hash of their own, see demcore/jit.py.
"""

from __future__ import annotations

from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

from demcore.source_hash import hash_sources


def demcore_folder() -> Path:
    """The folder of the demcore that this process would import."""
    spec = find_spec("demcore")
    assert spec is not None and spec.submodule_search_locations is not None, "demcore is part of the install"
    return Path(next(iter(spec.submodule_search_locations)))


@lru_cache(maxsize=1)
def demcore_hash() -> str:
    """The hash of that demcore."""
    return hash_sources(demcore_folder())

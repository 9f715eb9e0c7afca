"""The one place for Numba options, so that decorators stay typed and every kernel obeys the same arithmetic.

No fastmath: every kernel keeps IEEE order, so that serial and threaded runs, and a run that was resumed, give
the same bits. `error_model="numpy"` drops Python's division checks from the inner loops.

Numba's cache looks only at the file of the compiled function, not at the laws that it inlines from other
modules. So the cache folder carries a hash of all demcore sources: an edit anywhere starts a new cache.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import FunctionType
from typing import Any, TypeVar, cast

import numba
from numba.extending import overload

from demcore.source_hash import hash_sources

_HERE = Path(__file__).parent
_CACHE_BASE = Path(os.environ.get("NUMBA_CACHE_DIR") or _HERE / "__pycache__")
cast(Any, numba.config).CACHE_DIR = str(_CACHE_BASE / f"numba-{hash_sources(_HERE)[:16]}")
# A step of a small bed takes half a millisecond and its threads meet twice: OpenMP's threads wait awake for the
# next meeting, those of TBB go to sleep (7,838 spheres on two cores: 0.63 ms a step against 0.93). Where there is
# no OpenMP, Numba takes the next.
cast(Any, numba.config).THREADING_LAYER_PRIORITY = ["omp", "tbb", "workqueue"]

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """A compiled, cached loop that releases the interpreter lock."""
    return cast(F, numba.njit(cache=True, nogil=True, error_model="numpy")(function))


def parallel_kernel(function: F) -> F:
    """As `kernel`, with prange on Numba's threads.

    Numba's cache tells functions apart by name and code but not by options, so this is compiled under a name of
    its own: the same source may also be a serial kernel.
    """
    twin = FunctionType(function.__code__, function.__globals__, function.__name__, function.__defaults__)
    twin.__qualname__ = f"{function.__qualname__}_threaded"
    return cast(F, numba.njit(cache=True, nogil=True, error_model="numpy", parallel=True)(twin))


def leaf(function: F) -> F:
    """A pure scalar function that LLVM inlines into its kernel."""
    return cast(F, numba.njit(error_model="numpy", forceinline=True)(function))


prange = numba.prange
# How many threads a parallel kernel has. Asked outside of kernels: one that asks is not cached.
thread_count = numba.get_num_threads


def law_dispatch(laws: Mapping[Any, Callable[..., Any]], generic: F) -> F:
    """Let `generic(law, ...)` call the implementation that belongs to the type of `law`.

    The choice is made while compiling, from the NamedTuple's type, so a composed contact model costs nothing at
    run time; without JIT, `generic` itself looks the implementation up.
    """

    def choose(law: Any, *arguments: Any) -> Callable[..., Any]:  # noqa: ARG001 (Numba matches the names)
        implementation = laws[law.instance_class]

        def call(law: Any, *arguments: Any) -> Any:
            return implementation(law, *arguments)

        return call

    overload(generic, jit_options={"error_model": "numpy", "forceinline": True}, strict=False)(choose)
    return generic

"""How fast demcore itself runs on a bed: rate, contacts, rebuilds, memory, and where the time goes."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, cast

import numba
import numpy as np

from demcore.bench.beds import RUN_IN, Bed
from demcore.errors import InputError
from demcore.forces import NEVER, touching_contacts
from demcore.simulation import Simulation


@dataclass(frozen=True)
class Course:
    """One timed stretch of steps; contacts and pairs at its end."""

    seconds: float
    search_seconds: float
    rebuilds: int
    contacts: int
    pairs: int


def most_threads() -> int:
    """As many as Numba was started with."""
    return int(cast(Any, numba.config).NUMBA_NUM_THREADS)


def check_threads(threads: int) -> None:
    """Raises InputError for a thread count that this process cannot run."""
    if not 1 <= threads <= most_threads():
        raise InputError("threads", threads, f"1 to {most_threads()} on this machine")


class Runner:
    """A bed under one law on so many threads: run in once, then timed as often as asked."""

    def __init__(self, bed: Bed, law: str, threads: int) -> None:
        check_threads(threads)
        self.threads = threads
        self.search_seconds = 0.0
        self.simulation = bed.simulation(law, threaded=threads > 1)
        self._time_searches()
        numba.set_num_threads(threads)
        clock = time.perf_counter()
        self.simulation.advance(1)
        # Compilation, where the cache had nothing; else loading from the cache.
        self.first_call_seconds = time.perf_counter() - clock
        self.simulation.advance(RUN_IN[law] - 1)

    def _time_searches(self) -> None:
        search = self.simulation._search

        def timed() -> None:
            clock = time.perf_counter()
            search()
            self.search_seconds += time.perf_counter() - clock

        self.simulation._search = timed  # type: ignore[method-assign]

    def course(self, steps: int) -> Course:
        """Time the next `steps` steps."""
        numba.set_num_threads(self.threads)
        s = self.simulation
        searches, self.search_seconds = s.searches, 0.0
        clock = time.perf_counter()
        s.advance(steps)
        seconds = time.perf_counter() - clock
        pairs, contacts = count_pairs(s)
        return Course(seconds, self.search_seconds, s.searches - searches, contacts, pairs)


def count_pairs(simulation: Simulation) -> tuple[int, int]:
    """Listed pairs, and those of them that touched at the last step; walls not counted."""
    lists = simulation.neighbours
    near = int(np.count_nonzero(lists.wake < NEVER))
    return int(lists.used.sum()) + near, len(touching_contacts(lists).owner)


def peak_of_search(simulation: Simulation) -> int:
    """Bytes of all arrays when memory is fullest: old and new particles, lists and histories, and the grid.

    Counted, not read off the process, whose compiler and libraries weigh more than a small bed: what is held
    before a search, plus the peak of what NumPy allocates in it, plus what compiled code allocated and returned.
    """
    held = sum(array.nbytes for array in _arrays(simulation))
    simulation.stale = True
    tracemalloc.start()
    try:
        # One step: the search that is due, and the step itself, which allocates nothing of the particles' size.
        simulation.advance(1)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    compiled = sum(a.nbytes for a in _arrays(simulation) if not (a.flags.owndata or _is_view(a)))
    return int(held + peak + compiled)


def _arrays(simulation: Simulation) -> Iterator[Any]:
    for record in (simulation.particles, simulation.neighbours):
        for value in record:
            if isinstance(value, np.ndarray):
                yield value


def _is_view(array: Any) -> bool:
    return isinstance(array.base, np.ndarray)

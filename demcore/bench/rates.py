"""How fast demcore itself runs on a bed: rate, contacts, rebuilds, memory, and where the time goes."""

from __future__ import annotations

import gc
import time
import tracemalloc
from dataclasses import dataclass
from typing import Any, cast

import numba
import numpy as np

from demcore.bench.beds import CALM_SECONDS, RUN_IN, Bed
from demcore.dormancy import Dormancy
from demcore.errors import InputError
from demcore.forces import NEVER, touching_contacts
from demcore.neighbours import carry
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
    """A bed under one law on so many threads: run in once, then timed as often as asked. `calm`: run in until the
    bed lies still, which shows what dormancy is good for."""

    def __init__(
        self, bed: Bed, law: str, threads: int, dormancy: Dormancy | None = None, calm: bool = False
    ) -> None:
        check_threads(threads)
        self.threads = threads
        self.search_seconds = 0.0
        self.simulation = bed.simulation(law, threads > 1, dormancy)
        self._time_searches()
        numba.set_num_threads(threads)
        clock = time.perf_counter()
        self.simulation.advance(1)
        # Compilation, where the cache had nothing; else loading from the cache.
        self.first_call_seconds = time.perf_counter() - clock
        steps = round(CALM_SECONDS / self.simulation.dt) if calm else RUN_IN[law]
        self.simulation.advance(steps - 1)

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
    """Bytes of all arrays when memory is fullest: particles old and new, contacts old and new, and the grid.

    Counted, not read off the process, whose compiler and libraries weigh more than a small bed: the peak of what
    NumPy holds, and the contacts that compiled code carries across the search.
    """
    carried = sum(array.nbytes for array in carry(simulation.neighbours))
    tracemalloc.start()
    try:
        # Copies are traced, so that what a search lets go of is seen to go.
        simulation.particles = _copy(simulation.particles)
        simulation.neighbours = _copy(simulation.neighbours)
        simulation.near_walls = _copy(simulation.near_walls)
        gc.collect()
        tracemalloc.reset_peak()
        simulation.stale = True
        # One step: the search that is due, and the step itself, which allocates nothing of the particles' size.
        simulation.advance(1)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return int(peak) + carried


def _copy(record: Any) -> Any:
    return type(record)(*(value.copy() for value in record))

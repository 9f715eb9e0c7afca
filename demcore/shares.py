"""Which slabs each thread computes: shared out by cost, not by number.

A slab of a bed holds many times as many open contacts as one of the air above it, and as one of a bed that sleeps.
In equal numbers of neighbouring slabs, as a threaded loop shares them, one of two threads had four fifths of the
work under a jet of iron. Who computes a slab changes no bit (forces.py).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.dormant import AWAKE
from demcore.forces import Neighbours
from demcore.jit import kernel
from demcore.particles import Floats
from demcore.wall_list import WallList

# What an awake particle near walls, and a move, cost beside an open contact: 100, 8 and 35 ns.
PAIRS_A_WALL, PAIRS_A_MOVE = 3.0, 0.25


class Shares(NamedTuple):
    """Which turns each of W workers takes: turn[start[w]:start[w + 1]]."""

    turn: NDArray[np.int64]
    start: NDArray[np.int64]


@kernel
def share_out(weight: Floats, workers: int) -> Shares:
    """Turns of these weights (n,): the heaviest first, each to who has the least so far."""
    owner = np.empty(len(weight), np.int64)
    load = np.zeros(workers)
    for k in np.argsort(-weight):
        owner[k] = np.argmin(load)
        load[owner[k]] += weight[k]
    turn = np.argsort(owner, kind="mergesort")
    return Shares(turn, np.searchsorted(owner[turn], np.arange(workers + 1)))


@kernel
def share_slabs(
    lists: Neighbours, near: WallList, mode: NDArray[np.uint8], workers: int
) -> tuple[Shares, Shares]:
    """Turns over the even slabs, and turns of `finish_slabs`, by what they cost; `mode` (N,) of the particles."""
    count = len(lists.slab_start) - 1
    even, odd = np.zeros((count + 1) // 2), np.zeros(count // 2 + 1)
    for k in range(count):
        first, last = lists.slab_start[k], lists.slab_start[k + 1]
        walls = 0
        for p in range(np.searchsorted(near.owner, first), np.searchsorted(near.owner, last)):
            if mode[near.owner[p]] == AWAKE:
                walls += 1
        pairs = lists.used[k] + PAIRS_A_WALL * walls
        odd[(k + 1) // 2] += PAIRS_A_MOVE * (last - first)
        if k % 2 == 0:
            even[k // 2] += pairs
        else:
            odd[(k + 1) // 2] += pairs
    return share_out(even, workers), share_out(odd, workers)

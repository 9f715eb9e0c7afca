"""The numbers behind the checks of a bed: who is lost, who is too fast, who is pressed too far.

Compiled, because a run asks after every chunk of steps: as array expressions they were a part of the time that a
small pile takes (docs/core.md).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from demcore.forces import Neighbours, history_at
from demcore.jit import kernel
from demcore.neighbours import slots_of
from demcore.particles import Floats
from demcore.wrench import OVERLAP


class Overlaps(NamedTuple):
    """Largest overlap of the listed pairs over the smaller radius, the row of that pair's owner (-1: none
    overlaps), and how many are above the limit."""

    worst: float
    owner: int
    beyond: int


@kernel
def first_lost(state: Floats) -> int:
    """The first row with a number that is not finite, or -1."""
    for i in range(len(state)):
        for c in range(state.shape[1]):
            if not math.isfinite(state[i, c]):
                return i
    return -1


@kernel
def first_faster(state: Floats, dt: float, share: float) -> int:
    """The first row that goes farther in a step than `share` of its radius, or -1."""
    for i in range(len(state)):
        way = share * state[i, 3]
        vx, vy, vz = state[i, 4], state[i, 5], state[i, 6]
        if (vx * vx + vy * vy + vz * vz) * dt * dt > way * way:
            return i
    return -1


@kernel
def pair_overlap(state: Floats, i: int, j: int) -> float:
    """Over the smaller radius; below zero where they do not touch."""
    dx, dy, dz = state[i, 0] - state[j, 0], state[i, 1] - state[j, 1], state[i, 2] - state[j, 2]
    a, b = state[i, 3], state[j, 3]
    return float((a + b - math.sqrt(dx * dx + dy * dy + dz * dz)) / min(a, b))


@kernel
def find_overlaps(lists: Neighbours, state: Floats, limit: float) -> Overlaps:
    """Of all contacts that are closed and all near pairs, in the order of the loop."""
    worst, owner, beyond = 0.0, -1, 0
    for k in range(2 * len(lists.used)):
        first, last = slots_of(lists, k)
        for s in range(first, last):
            if lists.history[history_at(s, OVERLAP)] > 0.0:
                share = pair_overlap(state, lists.owner[s], lists.partner[s])
                beyond += 1 if share > limit else 0
                if share > worst:
                    worst, owner = share, lists.owner[s]
    for q in range(lists.near_start[-1]):
        share = pair_overlap(state, lists.near_owner[q], lists.near_partner[q])
        beyond += 1 if share > limit else 0
        if share > worst:
            worst, owner = share, lists.near_owner[q]
    return Overlaps(worst, owner, beyond)

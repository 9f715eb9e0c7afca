"""Which walls are near which particles, with the histories of those that touched before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from demcore.geometry.walls import Walls, wall_distance
from demcore.jit import kernel
from demcore.particles import Floats
from demcore.wall_forces import WallList
from demcore.wrench import HISTORY_WIDTH


def empty_wall_list() -> WallList:
    """No particle near any wall: what the first search carries history from."""
    return WallList(
        np.zeros(0, np.int64), np.zeros(1, np.int64), np.zeros(0, np.int32), np.zeros((0, HISTORY_WIDTH))
    )


@kernel
def list_walls(state: Floats, walls: Walls, skin: float, order: NDArray[np.int64], old: WallList) -> WallList:
    """Walls within reach + skin of each particle; `order` (N,) are the particles' rows at the last search."""
    count = np.zeros(len(state), np.int64)
    for i in range(len(state)):
        for w in range(len(walls.kind)):
            if walls.kind[w] >= 0:
                d, _ = wall_distance(walls.kind[w], walls.data, w, state[i, 0], state[i, 1], state[i, 2])
                if d < state[i, 3] + skin:
                    count[i] += 1
    owner = np.flatnonzero(count)
    start = np.zeros(len(owner) + 1, np.int64)
    start[1:] = np.cumsum(count[owner])
    wall = np.empty(start[-1], np.int32)
    history = np.zeros((start[-1], HISTORY_WIDTH))
    k = 0
    for p in range(len(owner)):
        i = owner[p]
        row = np.searchsorted(old.owner, order[i])
        known = row < len(old.owner) and old.owner[row] == order[i]
        for w in range(len(walls.kind)):
            if walls.kind[w] < 0:
                continue
            d, _ = wall_distance(walls.kind[w], walls.data, w, state[i, 0], state[i, 1], state[i, 2])
            if d >= state[i, 3] + skin:
                continue
            wall[k] = w
            if known:
                for q in range(old.start[row], old.start[row + 1]):
                    if old.wall[q] == w:
                        history[k] = old.history[q]
            k += 1
    return WallList(owner, start, wall, history)

"""Which walls are near which particles: the record that the search makes and the force loop keeps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.jit import leaf
from demcore.particles import Floats
from demcore.wrench import HISTORY_WIDTH, forget

# Columns of `hit` behind distance and normal.
FEATURE, STATE = 4, 5
HIT_WIDTH = 6


class WallList(NamedTuple):
    """Walls within reach of the few particles that have any: slots start[p] to start[p + 1] - 1 belong to the
    particle in row owner[p], ascending (P,); the slots of one wall lie side by side.

    wall, triangle (K,)  what the slot is about; triangle -1 for an analytic wall
    clear (K,)           square of the way that the particle may go from its home (forces.py) before it can touch,
                         m2; -1 where it touched at the search, and for a wall that moves
    history (K, 10)      as of any contact (wrench.py); overlap 0: not in contact
    normal (K, 3)        from the wall to the particle when it last touched
    push (K, 3)          force of the wall on the particle at the last step, N; 0 without contact
    hit (K, 6)           of a triangle at this step: distance, normal 3, feature, state
    crossed (P,)         wall that the particle went through, or -1
    alarm (1,)           True when any did
    """

    owner: NDArray[np.int64]
    start: NDArray[np.int64]
    wall: NDArray[np.int32]
    triangle: NDArray[np.int32]
    clear: Floats
    history: Floats
    normal: Floats
    push: Floats
    hit: Floats
    crossed: NDArray[np.int32]
    alarm: NDArray[np.bool_]


def empty_wall_list() -> WallList:
    """No particle near any wall: what the first search carries history from."""
    none, zero = np.zeros(0, np.int32), np.zeros((0, 3))
    return WallList(
        owner=np.zeros(0, np.int64),
        start=np.zeros(1, np.int64),
        wall=none,
        triangle=none,
        clear=np.zeros(0),
        history=np.zeros((0, HISTORY_WIDTH)),
        normal=zero,
        push=zero,
        hit=np.zeros((0, HIT_WIDTH)),
        crossed=none,
        alarm=np.zeros(1, np.bool_),
    )


@leaf
def forget_slot(near: WallList, k: int) -> None:
    """A contact has opened."""
    forget(near.history, k)
    for c in range(3):
        near.push[k, c] = 0.0

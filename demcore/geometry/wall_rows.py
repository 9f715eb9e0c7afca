"""The columns of the arrays that describe walls to the kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

PLANE, REVOLUTION, TRIANGLES = 0, 1, 2

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Columns of `shape`.
PROFILE, BELT, BELT_SPEED, EXTENT = 0, 4, 7, 8
# Columns of `rest`.
PIVOT, OFFSET, ROTATION = 0, 3, 6
# Columns of `motion`.
VELOCITY, SPIN, AMPLITUDE, FREQUENCY, PHASE, ANGLE, AXIS, MOVES = 0, 3, 6, 9, 10, 11, 12, 15
# Columns of `pose`.
CENTRE, TURN, PIVOT_NOW, VELOCITY_NOW, SPIN_NOW = 0, 3, 12, 15, 18
# Columns of `home`.
HOME_PIVOT, HOME_TURN, REACH = 0, 3, 12


class Walls(NamedTuple):
    """All walls of a simulation, one row each; made by `wall_arrays`.

    kind (W,)           PLANE, REVOLUTION or TRIANGLES
    material (W,)       row of the material tables
    window (W, 2)       from and until when it is there, s
    shape (W, 9)        profile (start radius, direction 2, length); belt direction 3 (body frame) and speed;
                        farthest point from the pivot that a turn moves, m
    rest (W, 15)        pivot 3; centre minus pivot 3; rotation 9, row by row: where it is before it moves
    motion (W, 17)      velocity 3, angular velocity 3; amplitude 3, frequency, phase, angle, axis 3 of the
                        oscillation; moves from and until, s
    pose (W, 21)        centre 3, rotation 9, pivot 3 now; velocity of the pivot 3 and spin 3 half a step ago
    home (W, 13)        pivot 3 and rotation 9 at the last search; farthest point that mattered then, m
    triangle (T, 12)    three corners and unit normal, body frame; those of wall w are first_triangle[w] on
    box (B, 6)          their trees (triangle_tree.py); that of wall w begins at first_box[w]
    """

    kind: Integers
    material: Integers
    window: Floats
    shape: Floats
    rest: Floats
    motion: Floats
    pose: Floats
    home: Floats
    triangle: Floats
    first_triangle: Integers
    box: Floats
    first_box: Integers

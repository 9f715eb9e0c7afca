"""Analytic walls as triangles, for the eye: a body of revolution as a band, a plane as a square patch of it.

Notation: a body of revolution about the axis z through the origin is the segment from (rho, h) = `start` to `end`
of the half plane of radius and height; SEGMENTS sides stand for the circle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Triangles = NDArray[np.int64]

# A side of a 64-sided tube is 0.1 % of its radius inside the circle.
SEGMENTS = 64
# A cone's tip is computed, and misses the axis by rounding.
ON_AXIS = 1e-9


def revolution(start: tuple[float, float], end: tuple[float, float]) -> tuple[Floats, Triangles]:
    """Points (P, 3) and triangles (T, 3) of a band; an end on the axis is a single point."""
    angle = 2.0 * np.pi * np.arange(SEGMENTS) / SEGMENTS
    rings = []
    for rho, h in (start, end):
        if rho <= ON_AXIS * max(start[0], end[0]):
            rings.append(np.array([[0.0, 0.0, h]]))
        else:
            rings.append(np.column_stack([rho * np.cos(angle), rho * np.sin(angle), np.full(SEGMENTS, h)]))
    here = np.arange(SEGMENTS)
    following = (here + 1) % SEGMENTS
    first = len(rings[0])
    triangles = []
    if first > 1:
        outer = first + (here if len(rings[1]) > 1 else np.zeros(SEGMENTS, np.int64))
        triangles.append(np.column_stack([here, following, outer]))
    if len(rings[1]) > 1:
        inner = following if first > 1 else np.zeros(SEGMENTS, np.int64)
        triangles.append(np.column_stack([inner, first + following, first + here]))
    return np.concatenate(rings), np.concatenate(triangles)


def square(half: float) -> tuple[Floats, Triangles]:
    """A square of half side `half`, m, in z = 0."""
    corners = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    return half * corners, np.array([[0, 1, 2], [0, 2, 3]])

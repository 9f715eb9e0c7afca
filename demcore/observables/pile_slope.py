"""How steep a heap of a burden lies: the check of a charge against the pile test of the same grains.

Notation: rho distance from the heap's summit in plan, m; z height of the surface, m. In each direction from the
summit z falls by tan(slope) a metre, by least squares from NEAR to FAR; directions in which the burden ends
sooner (the wall, the floor) or that do not fall (the other heap) say nothing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from demcore.observables.burden import Surface

DIRECTIONS = 16
# Part of the flank that is read, m: off the rounded top, and long against the grains.
NEAR, FAR = 0.2, 1.2
# Of that length, a direction must have so much; and so many cells.
LEAST_SHARE, FEWEST = 0.7, 30
# What is thinner, m, is floor.
THINNEST = 0.02


class Slope(NamedTuple):
    """Mean over the directions that say something, degrees, its standard error (nan for one), and how many."""

    angle_deg: float
    error_deg: float
    directions: int


def pile_slope(surface: Surface, azimuth_deg: float, radius: float) -> Slope:
    """Of the heap whose summit lies at this azimuth and distance from the axis, m; nan where no flank is free."""
    turn = math.radians(azimuth_deg)
    dx, dy = surface.x - radius * math.cos(turn), surface.y - radius * math.sin(turn)
    rho = np.hypot(dx, dy)
    flank = (rho >= NEAR) & (rho <= FAR) & (surface.thickness > THINNEST)
    way = ((np.arctan2(dy, dx) % (2.0 * np.pi)) / (2.0 * np.pi) * DIRECTIONS).astype(np.int64) % DIRECTIONS
    angles = []
    for k in range(DIRECTIONS):
        there = flank & (way == k)
        if there.sum() < FEWEST or np.ptp(rho[there]) < LEAST_SHARE * (FAR - NEAR):
            continue
        fall = -float(np.polyfit(rho[there], surface.top[there], 1)[0])
        if fall > 0.0:
            angles.append(math.degrees(math.atan(fall)))
    if not angles:
        return Slope(math.nan, math.nan, 0)
    error = float(np.std(angles, ddof=1)) / math.sqrt(len(angles)) if len(angles) > 1 else math.nan
    return Slope(float(np.mean(angles)), error, len(angles))

"""How steep a heap of a burden lies: the check of a charge against the pile test of the same grains.

Grains that rest freely lie at most at their angle of repose; most of a burden lies flatter: the other heap,
the saddle between them or the wall holds it up. So what is told is the steepest quarter of the heap's flanks.

Notation: rho distance from the heap's summit in plan, m; z height of the surface, m. In each of DIRECTIONS wedges
about the summit a plane z = a + b x + c y is fitted from NEAR to FAR by least squares, and the flank's slope is
atan(hypot(b, c)): that of steepest descent, wherever it points. A cone's wedge reads high by at most the factor
1 / cos(180 / DIRECTIONS) of its tangent. Wedges in which the burden ends sooner (the wall, the floor) or does not
fall away from the summit (the other heap) say nothing.
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
# Of the flanks, and at least so many where there are as many.
STEEPEST, FEWEST_FLANKS = 0.25, 2


class Slope(NamedTuple):
    """Mean of the steepest quarter of the flanks, two at least, degrees; its standard error by their scatter (nan
    for one flank), by which they also lie high, being the steepest; and how many flanks there are in all."""

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
        plan = np.column_stack([np.ones(there.sum()), dx[there], dy[there]])
        _, b, c = np.linalg.lstsq(plan, surface.top[there], rcond=None)[0]
        if b * dx[there].mean() + c * dy[there].mean() < 0.0:
            angles.append(math.degrees(math.atan(math.hypot(b, c))))
    if not angles:
        return Slope(math.nan, math.nan, 0)
    steepest = sorted(angles)[-max(FEWEST_FLANKS, math.ceil(STEEPEST * len(angles))) :]
    many = len(steepest)
    error = float(np.std(steepest, ddof=1)) / math.sqrt(many) if many > 1 else math.nan
    return Slope(float(np.mean(steepest)), error, len(angles))

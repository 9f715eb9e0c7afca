"""Filling: where new particles go, without overlaps.

Random sequential addition into an upright cylinder, the largest first, with a cell grid for the overlap test.
Its density stays below about 0.35 for equal spheres, so a fill is a loose column that falls into place.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from demcore.errors import InputError
from demcore.jit import kernel, leaf
from demcore.particles import Floats

LOOSE_FRACTION = 0.28
ATTEMPTS = 2000


@leaf
def is_free(
    x: float,
    y: float,
    z: float,
    r: float,
    position: Floats,
    radius: Floats,
    head: NDArray[np.int64],
    following: NDArray[np.int64],
    cell: float,
    half: float,
) -> bool:
    """True where a sphere overlaps none that is placed; `head` (X, Y, Z) starts each cell's chain."""
    # Placed in order of size: the first sphere is the largest.
    reach = r + radius[0]
    across, up = head.shape[0], head.shape[2]
    for ix in range(
        max(0, int((x + half - reach) / cell)), min(across - 1, int((x + half + reach) / cell)) + 1
    ):
        for iy in range(
            max(0, int((y + half - reach) / cell)), min(across - 1, int((y + half + reach) / cell)) + 1
        ):
            for iz in range(max(0, int((z - reach) / cell)), min(up - 1, int((z + reach) / cell)) + 1):
                j = head[ix, iy, iz]
                while j >= 0:
                    dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
                    apart = r + radius[j]
                    if dx * dx + dy * dy + dz * dz < apart * apart:
                        return False
                    j = following[j]
    return True


@kernel
def place_spheres(radius: Floats, half: float, height: float, cell: float, seed: int) -> tuple[Floats, int]:
    """Positions of spheres in a cylinder of radius `half` on z = 0, and how many found a place.

    `radius` is in placing order, the largest first.
    """
    np.random.seed(seed)
    n = len(radius)
    position = np.zeros((n, 3))
    across, up = int(2.0 * half / cell) + 1, int(height / cell) + 1
    head = np.full((across, across, up), -1, np.int64)
    following = np.full(n, -1, np.int64)
    for i in range(n):
        r = radius[i]
        for attempt in range(ATTEMPTS + 1):
            if attempt == ATTEMPTS:
                return position, i
            rho = (half - r) * math.sqrt(np.random.random())
            angle = 2.0 * math.pi * np.random.random()
            x, y = rho * math.cos(angle), rho * math.sin(angle)
            z = r + (height - 2.0 * r) * np.random.random()
            if is_free(x, y, z, r, position, radius, head, following, cell, half):
                position[i, 0], position[i, 1], position[i, 2] = x, y, z
                ix, iy, iz = int((x + half) / cell), int((y + half) / cell), int(z / cell)
                following[i] = head[ix, iy, iz]
                head[ix, iy, iz] = i
                break
    return position, n


def fill_cylinder(
    radius: NDArray[np.float64], cylinder_radius: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Positions (N, 3), m, of spheres in a loose column above z = 0 inside a cylinder, none overlapping.

    Raises InputError for a particle that is larger than the cylinder.
    """
    largest = float(radius.max())
    if largest > 0.5 * cylinder_radius:
        raise InputError(
            "scale",
            largest * 2.0,
            f"particles of at most {cylinder_radius:g} m, half the cylinder's diameter",
        )
    order = np.argsort(-radius, kind="stable")
    volume = 4.0 / 3.0 * math.pi * float((radius**3).sum())
    height = volume / (LOOSE_FRACTION * math.pi * cylinder_radius**2) + 2.0 * largest
    seed = int(rng.integers(2**31))
    while True:
        # A cell of the mean diameter keeps the chains short whatever the size ratio.
        cell = 2.0 * float(radius.mean())
        placed, count = place_spheres(radius[order], cylinder_radius, height, cell, seed)
        if count == len(radius):
            break
        height *= 1.1
    position = np.empty_like(placed)
    position[order] = placed
    return position

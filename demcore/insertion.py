"""Filling: where new particles go, without overlaps.

Random sequential addition into an upright cylinder, the largest first, with a cell grid for the overlap test.
Its density stays below about 0.35 for equal spheres, so a fill is a loose column that falls into place.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from demcore.errors import InputError
from demcore.jit import kernel
from demcore.particles import Floats

LOOSE_FRACTION = 0.28
ATTEMPTS = 2000


@kernel
def place_spheres(
    radius: Floats, uniforms: Floats, cylinder_radius: float, height: float, cell: float, seed: int
) -> tuple[Floats, int]:
    """Positions of spheres in a cylinder that stands on z = 0; also how many found a place.

    `radius` is in placing order; `uniforms` (N, 3) are the first tries, later ones come from `seed`.
    """
    np.random.seed(seed)
    n = len(radius)
    position = np.zeros((n, 3))
    across = int(2.0 * cylinder_radius / cell) + 1
    up = int(height / cell) + 1
    head = np.full(across * across * up, -1, np.int64)
    following = np.full(n, -1, np.int64)
    largest = radius[0]
    for i in range(n):
        r = radius[i]
        placed = False
        for attempt in range(ATTEMPTS):
            if attempt == 0:
                a, b, c = uniforms[i, 0], uniforms[i, 1], uniforms[i, 2]
            else:
                a, b, c = np.random.random(), np.random.random(), np.random.random()
            rho = (cylinder_radius - r) * math.sqrt(a)
            x, y, z = rho * math.cos(2.0 * math.pi * b), rho * math.sin(2.0 * math.pi * b), r + (height - 2.0 * r) * c
            reach = r + largest
            free = True
            for ix in range(
                max(0, int((x + cylinder_radius - reach) / cell)),
                min(across - 1, int((x + cylinder_radius + reach) / cell)) + 1,
            ):
                for iy in range(
                    max(0, int((y + cylinder_radius - reach) / cell)),
                    min(across - 1, int((y + cylinder_radius + reach) / cell)) + 1,
                ):
                    for iz in range(max(0, int((z - reach) / cell)), min(up - 1, int((z + reach) / cell)) + 1):
                        j = head[(ix * across + iy) * up + iz]
                        while j >= 0:
                            dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
                            apart = r + radius[j]
                            if dx * dx + dy * dy + dz * dz < apart * apart:
                                free = False
                                break
                            j = following[j]
                        if not free:
                            break
                    if not free:
                        break
                if not free:
                    break
            if free:
                placed = True
                break
        if not placed:
            return position, i
        position[i, 0], position[i, 1], position[i, 2] = x, y, z
        ix, iy, iz = int((x + cylinder_radius) / cell), int((y + cylinder_radius) / cell), int(z / cell)
        place = (ix * across + iy) * up + iz
        following[i] = head[place]
        head[place] = i
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
            "scale", largest * 2.0, f"particles of at most {cylinder_radius:g} m, half the cylinder's diameter"
        )
    order = np.argsort(-radius, kind="stable")
    volume = 4.0 / 3.0 * math.pi * float((radius**3).sum())
    height = volume / (LOOSE_FRACTION * math.pi * cylinder_radius**2) + 2.0 * largest
    seed = int(rng.integers(2**31))
    while True:
        # A cell of the mean diameter keeps the chains short whatever the size ratio.
        cell = 2.0 * float(radius.mean())
        uniforms = rng.random((len(radius), 3))
        placed, count = place_spheres(radius[order], uniforms, cylinder_radius, height, cell, seed)
        if count == len(radius):
            break
        height *= 1.1
    position = np.empty_like(placed)
    position[order] = placed
    return position

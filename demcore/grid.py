"""Cells by size level, so that small particles are searched in small cells whatever the size ratio.

Notation: reach R radius and halo, m, of a particle: a pair is listed whose reaches overlap; level l holds reaches
in (R_max 2^-(l+1), R_max 2^-l], so that a fast particle is searched like a large one; the owner of a pair is the
lower index.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.dormant import AWAKE
from demcore.jit import kernel
from demcore.particles import Floats, X, Z

Integers = NDArray[np.int64]

CELLS_PER_PARTICLE = 8


class Grid(NamedTuple):
    """Cells of all levels in one array. level (N,); size (L,), m; dims (L, 3); offset (L,) into start;
    items in cell c: item[start[c]:start[c + 1]], ascending."""

    level: NDArray[np.int64]
    largest: Floats
    size: Floats
    dims: Integers
    offset: Integers
    origin: Floats
    start: Integers
    item: NDArray[np.int32]


@kernel
def bin_particles(state: Floats, cell_of: Integers, grid: Grid) -> None:
    """Counting sort of the particles into the cells of their level."""
    start = grid.start
    for i in range(len(cell_of)):
        level = grid.level[i]
        cell = 0
        for c in range(3):
            q = int((state[i, c] - grid.origin[c]) / grid.size[level])
            cell = cell * grid.dims[level, c] + min(max(q, 0), grid.dims[level, c] - 1)
        cell_of[i] = grid.offset[level] + cell
        start[cell_of[i] + 1] += 1
    for c in range(len(start) - 1):
        start[c + 1] += start[c]
    fill = start[:-1].copy()
    for i in range(len(cell_of)):
        grid.item[fill[cell_of[i]]] = i
        fill[cell_of[i]] += 1


def build_grid(state: Floats, reach: Floats) -> Grid:
    """Bin particles by size level; see `Grid`."""
    largest, smallest = float(reach.max()), float(reach.min())
    levels = int(np.floor(np.log2(largest / smallest) + 1e-9)) + 1
    level = np.minimum(np.floor(np.log2(largest / reach) + 1e-9).astype(np.int64), levels - 1)
    biggest: Floats = largest * 0.5 ** np.arange(levels, dtype=np.float64)
    # The level is computed with a tolerance, so a reach may exceed its level's bound by rounding.
    biggest *= 1.0 + 1e-6
    size: Floats = 2.0 * biggest
    position = state[:, X : Z + 1]
    origin = position.min(axis=0)
    extent = position.max(axis=0) - origin
    # Few cells when particles are spread over a large box: memory stays linear in their number.
    most = CELLS_PER_PARTICLE * len(reach) + 4096
    for k in range(levels):
        while np.prod(np.floor(extent / size[k]) + 1.0) > most:
            size[k] *= 1.26
    dims = (np.floor(extent / size[:, None]) + 1).astype(np.int64)
    cells = dims.prod(axis=1)
    offset = np.concatenate([[0], np.cumsum(cells)[:-1]]).astype(np.int64)
    start = np.zeros(int(cells.sum()) + 1, np.int64)
    item = np.empty(len(reach), np.int32)
    grid = Grid(level, biggest, size, dims, offset, origin, start, item)
    bin_particles(state, np.empty(len(reach), np.int64), grid)
    return grid


@kernel
def find_partners(
    first: int,
    last: int,
    state: Floats,
    reach: Floats,
    mode: NDArray[np.uint8],
    grid: Grid,
    found: NDArray[np.int32],
    count: Integers,
) -> tuple[int, int, int]:
    """Partners j > i within reach of particles first to last - 1, one after another into `found`.

    Returns how many there are, how many of them touch, and how many of those are still: neither is awake. When
    there are more than `found` holds, the surplus was counted only.
    """
    total = touching = still = 0
    for i in range(first, last):
        before = total
        x, y, z, r, own = state[i, 0], state[i, 1], state[i, 2], state[i, 3], reach[i]
        for level in range(len(grid.size)):
            farthest = own + grid.largest[level]
            inverse = 1.0 / grid.size[level]
            dx, dy, dz = x - grid.origin[0], y - grid.origin[1], z - grid.origin[2]
            nx, ny, nz = grid.dims[level, 0], grid.dims[level, 1], grid.dims[level, 2]
            for cx in range(
                max(0, int((dx - farthest) * inverse)), min(nx - 1, int((dx + farthest) * inverse)) + 1
            ):
                for cy in range(
                    max(0, int((dy - farthest) * inverse)), min(ny - 1, int((dy + farthest) * inverse)) + 1
                ):
                    row = grid.offset[level] + (cx * ny + cy) * nz
                    z0 = max(0, int((dz - farthest) * inverse))
                    z1 = min(nz - 1, int((dz + farthest) * inverse))
                    # Cells along z lie side by side: one run of items.
                    for q in range(grid.start[row + z0], grid.start[row + z1 + 1]):
                        j = grid.item[q]
                        if j <= i:
                            continue
                        ax, ay, az = x - state[j, 0], y - state[j, 1], z - state[j, 2]
                        squared = ax * ax + ay * ay + az * az
                        known = own + reach[j]
                        if squared < known * known:
                            if total < len(found):
                                found[total] = j
                            total += 1
                            limit = r + state[j, 3]
                            if squared < limit * limit:
                                touching += 1
                                still += 1 if mode[i] != AWAKE and mode[j] != AWAKE else 0
        count[i] = total - before
    return total, touching, still

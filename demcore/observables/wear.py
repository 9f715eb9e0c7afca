"""What walls bear: energy of the grains that strike them, and the load of those that lie there, by place.

Notation: n unit normal from a wall to a grain's centre, d the centre's distance, m; r radius, m; u speed towards
the wall, m/s. A grain strikes a wall within the time dt when d - r <= u dt; it then brings m u^2 / 2 across it.
Looking ahead from every look to the next one counts each flight that ends on a wall once, without a look at every
step; a grain that another one stops within that way is counted too (some centimetres at the jet's speed).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.geometry.motion import to_body, turn_to_world
from demcore.geometry.surfaces import triangle_distance
from demcore.geometry.triangle_tree import LEAF, following, next_leaf
from demcore.geometry.wall_rows import TRIANGLES, Walls
from demcore.jit import kernel, leaf
from demcore.particles import Floats
from demcore.wall_forces import wall_distance
from demcore.wall_list import WallList

# Side of the cells of a map, m.
CELL = 0.1


class Strike(NamedTuple):
    """Grains that strike walls: wall (K,), place (K, 3) m, energy across the wall (K,) J."""

    wall: NDArray[np.int64]
    place: Floats
    energy: Floats


@leaf
def nearest_triangle(
    walls: Walls, w: int, x: float, y: float, z: float, reach: float
) -> tuple[float, float, float, float]:
    """Distance of a point to mesh w and the normal towards it; inf beyond `reach`."""
    q = to_body(walls.pose, w, x, y, z)
    first, count = walls.first_triangle[w], walls.first_triangle[w + 1] - walls.first_triangle[w]
    box = walls.first_box[w]
    leaves = (walls.first_box[w + 1] - box) // 2
    node = next_leaf(walls.box, box, leaves, 1, q, reach)
    best, nx, ny, nz = np.inf, 0.0, 0.0, 0.0
    while node > 0:
        for t in range((node - leaves) * LEAF, min((node - leaves + 1) * LEAF, count)):
            d, normal, _ = triangle_distance(walls.triangle, first + t, q)
            if d < best:
                n = turn_to_world(walls.pose, w, normal)
                best, nx, ny, nz = d, n.x, n.y, n.z
        node = next_leaf(walls.box, box, leaves, following(node), q, reach)
    return best, nx, ny, nz


@kernel
def look_ahead(state: Floats, walls: Walls, present: NDArray[np.bool_], dt: float) -> Floats:
    """(K, 5) rows wall, place 3 and energy of every strike within the next dt, s."""
    rows = np.empty((64, 5))
    total = 0
    for i in range(len(state)):
        x, y, z, r = state[i, 0], state[i, 1], state[i, 2], state[i, 3]
        vx, vy, vz = state[i, 4], state[i, 5], state[i, 6]
        reach = r + dt * (abs(vx) + abs(vy) + abs(vz))
        for w in range(len(present)):
            if not present[w]:
                continue
            if walls.kind[w] == TRIANGLES:
                d, nx, ny, nz = nearest_triangle(walls, w, x, y, z, reach)
            else:
                d, n = wall_distance(walls.kind[w], walls.shape, walls.pose, w, x, y, z)
                nx, ny, nz = n.x, n.y, n.z
            if not r < d <= reach:
                continue
            u = -(vx * nx + vy * ny + vz * nz)
            if u <= 0.0 or d - r > u * dt:
                continue
            if total == len(rows):
                longer = np.empty((2 * total, 5))
                longer[:total] = rows
                rows = longer
            rows[total, 0] = w
            rows[total, 1], rows[total, 2], rows[total, 3] = x - d * nx, y - d * ny, z - d * nz
            rows[total, 4] = 0.5 * state[i, 7] * u * u
            total += 1
    return rows[:total]


def find_strikes(state: Floats, walls: Walls, present: NDArray[np.bool_], dt: float) -> Strike:
    """Grains (state rows of particles.py) that strike one of the walls that are `present` (W,) within dt, s. Walls
    stand still but for belts and what turns about its own axis, which bring nothing across themselves."""
    rows = look_ahead(state, walls, present, dt)
    return Strike(rows[:, 0].astype(np.int64), rows[:, 1:4].copy(), rows[:, 4].copy())


def find_loads(state: Floats, near: WallList) -> Strike:
    """What presses on walls now: wall, place and force across it, N, of every contact."""
    owner = np.repeat(near.owner, np.diff(near.start))
    force = (near.push * near.normal).sum(axis=1)
    pressed = force > 0.0
    place = state[owner[pressed], :3] - state[owner[pressed], 3:4] * near.normal[pressed]
    return Strike(near.wall[pressed].astype(np.int64), place, force[pressed])


class WearMap:
    """Energy, strikes and load of the walls by cells of CELL; only what was touched is kept."""

    def __init__(self) -> None:
        self.cells: dict[tuple[int, int, int, int], list[float]] = {}
        self.looks_at_load = 0

    def strike(self, strikes: Strike) -> None:
        """Count strikes in."""
        for key, energy in zip(_keys(strikes), strikes.energy.tolist(), strict=True):
            cell = self.cells.setdefault(key, [0.0, 0.0, 0.0])
            cell[0] += energy
            cell[1] += 1.0

    def load(self, loads: Strike) -> None:
        """Count one look at what lies there in."""
        self.looks_at_load += 1
        for key, force in zip(_keys(loads), loads.energy.tolist(), strict=True):
            self.cells.setdefault(key, [0.0, 0.0, 0.0])[2] += force

    def rows(self) -> tuple[NDArray[np.int64], Floats, Floats]:
        """wall (K,); middle of the cell (K, 3), m; energy J, strikes, mean load N (K, 3); by wall and place."""
        keys = sorted(self.cells)
        index = np.array(keys, np.int64).reshape(-1, 4)
        values = np.array([self.cells[k] for k in keys], np.float64).reshape(-1, 3)
        values[:, 2] /= max(self.looks_at_load, 1)
        return index[:, 0], np.asarray((index[:, 1:] + 0.5) * CELL), values

    def by_wall(self, walls: int) -> Floats:
        """(W, 3) energy J, strikes, mean load N of each wall."""
        wall, _, values = self.rows()
        return np.column_stack([np.bincount(wall, column, walls) for column in values.T])

    def numbers(self) -> dict[str, Any]:
        """State to save, JSON-able."""
        return {"cells": [[*k, *v] for k, v in self.cells.items()], "looks_at_load": self.looks_at_load}

    def restore(self, numbers: Mapping[str, Any]) -> None:
        """As `numbers` says."""
        self.cells = {(int(w), int(i), int(j), int(k)): values for w, i, j, k, *values in numbers["cells"]}
        self.looks_at_load = int(numbers["looks_at_load"])


def _keys(strikes: Strike) -> list[tuple[int, int, int, int]]:
    cell = np.floor(strikes.place / CELL).astype(np.int64)
    return [(w, i, j, k) for w, (i, j, k) in zip(strikes.wall.tolist(), cell.tolist(), strict=True)]

"""Where new particles find room: random sequential addition into a region, and free places at an inlet.

Fills place the largest first, from the region's bottom upwards, with a cell grid for the overlap test. Their
density stays below about 0.35 for equal spheres, so a fill is loose and falls into place.

Notation: x, y, z centre and r radius of a sphere, m. Spheres 0 to taken - 1 are there already.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.contact.model import Vec3
from demcore.errors import InputError
from demcore.geometry.motion import is_present, to_body
from demcore.geometry.surfaces import triangle_distance
from demcore.geometry.triangle_tree import LEAF, following, next_leaf
from demcore.geometry.wall_arrays import wall_arrays
from demcore.geometry.wall_rows import TRIANGLES, Walls
from demcore.jit import kernel, leaf
from demcore.particles import Floats
from demcore.region import Box, Region, cylinder
from demcore.wall_forces import wall_distance

LOOSE_FRACTION = 0.28
# A region counts as full when a particle finds no place in so many tries.
ATTEMPTS = 2000
# Cells per sphere at most: a sparse region must not cost memory.
CELLS_PER_SPHERE = 16
BOX, CONE = 0, 1


class Cells(NamedTuple):
    """A grid of chains: head (X, Y, Z) starts each cell's, following (N,) goes on; -1 ends it.

    origin (3,) m; size of a cell, m; largest radius of all spheres that will come, m.
    """

    head: NDArray[np.int64]
    following: NDArray[np.int64]
    origin: Floats
    size: float
    largest: float


@leaf
def cell_index(cells: Cells, axis: int, at: float) -> int:
    """The cell along one axis, clipped into the grid."""
    last: int = cells.head.shape[axis] - 1
    return min(max(int((at - cells.origin[axis]) / cells.size), 0), last)


@leaf
def is_free(x: float, y: float, z: float, r: float, position: Floats, radius: Floats, cells: Cells) -> bool:
    """True where a sphere overlaps none in the cells."""
    reach = r + cells.largest
    for ix in range(cell_index(cells, 0, x - reach), cell_index(cells, 0, x + reach) + 1):
        for iy in range(cell_index(cells, 1, y - reach), cell_index(cells, 1, y + reach) + 1):
            for iz in range(cell_index(cells, 2, z - reach), cell_index(cells, 2, z + reach) + 1):
                j = cells.head[ix, iy, iz]
                while j >= 0:
                    dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
                    apart = r + radius[j]
                    if dx * dx + dy * dy + dz * dz < apart * apart:
                        return False
                    j = cells.following[j]
    return True


@leaf
def chain(j: int, position: Floats, cells: Cells) -> None:
    """Put sphere j into its cell."""
    ix = cell_index(cells, 0, position[j, 0])
    iy = cell_index(cells, 1, position[j, 1])
    iz = cell_index(cells, 2, position[j, 2])
    cells.following[j] = cells.head[ix, iy, iz]
    cells.head[ix, iy, iz] = j


@leaf
def touches_mesh(q: Vec3, r: float, walls: Walls, w: int) -> bool:
    """True where a sphere overlaps a triangle of wall w; q is its centre in the wall's frame."""
    first, count = walls.first_triangle[w], walls.first_triangle[w + 1] - walls.first_triangle[w]
    box = walls.first_box[w]
    leaves = (walls.first_box[w + 1] - box) // 2
    node = next_leaf(walls.box, box, leaves, 1, q, r)
    while node > 0:
        for t in range((node - leaves) * LEAF, min((node - leaves + 1) * LEAF, count)):
            d, _, _ = triangle_distance(walls.triangle, first + t, q)
            if d < r:
                return True
        node = next_leaf(walls.box, box, leaves, following(node), q, r)
    return False


@leaf
def touches_wall(x: float, y: float, z: float, r: float, walls: Walls, there: NDArray[np.bool_]) -> bool:
    """True where a sphere overlaps one of the walls that are `there` (W,)."""
    for w in range(len(there)):
        if not there[w]:
            continue
        if walls.kind[w] == TRIANGLES:
            if touches_mesh(to_body(walls.pose, w, x, y, z), r, walls, w):
                return True
        else:
            d, _ = wall_distance(walls.kind[w], walls.shape, walls.pose, w, x, y, z)
            if d < r:
                return True
    return False


@leaf
def draw_point(kind: int, shape: Floats, top: float, r: float) -> tuple[float, float, float, bool]:
    """A uniform point for a sphere inside the region below `top`; False where the draw fell outside.

    shape of a box: lower and upper corner; of a cone: base, height, lower and upper radius.
    """
    if kind == BOX:
        x = shape[0] + r + (shape[3] - shape[0] - 2.0 * r) * np.random.random()
        y = shape[1] + r + (shape[4] - shape[1] - 2.0 * r) * np.random.random()
        z = shape[2] + r + (top - shape[2] - 2.0 * r) * np.random.random()
        return x, y, z, True
    slope = (shape[5] - shape[4]) / shape[3]
    # A sphere that touches the side is this far from it, measured level.
    level = r * math.sqrt(1.0 + slope * slope)
    widest = max(shape[4], shape[4] + slope * (top - shape[2])) - level
    rho = widest * math.sqrt(np.random.random())
    angle = 2.0 * math.pi * np.random.random()
    up = r + (top - shape[2] - 2.0 * r) * np.random.random()
    inside = widest >= 0.0 and rho <= shape[4] + slope * up - level
    return shape[0] + rho * math.cos(angle), shape[1] + rho * math.sin(angle), shape[2] + up, inside


def walls_at(walls: Walls, step: int, dt: float) -> NDArray[np.bool_]:
    """Which walls (W,) are there at a step."""
    return np.array([is_present(walls, w, step, dt) for w in range(len(walls.kind))], np.bool_)


@kernel
def place_spheres(
    kind: int,
    shape: Floats,
    top: float,
    position: Floats,
    radius: Floats,
    taken: int,
    walls: Walls,
    present: NDArray[np.bool_],
    cells: Cells,
    seed: int,
) -> int:
    """Find places for spheres `taken` and up, in order; how many spheres have one, those taken included."""
    np.random.seed(seed)
    for i in range(taken):
        chain(i, position, cells)
    for i in range(taken, len(radius)):
        r = radius[i]
        found = False
        for _ in range(ATTEMPTS):
            x, y, z, inside = draw_point(kind, shape, top, r)
            if (
                inside
                and is_free(x, y, z, r, position, radius, cells)
                and not touches_wall(x, y, z, r, walls, present)
            ):
                position[i, 0], position[i, 1], position[i, 2] = x, y, z
                chain(i, position, cells)
                found = True
                break
        if not found:
            return i
    return len(radius)


def _shape(region: Region) -> tuple[int, Floats]:
    if isinstance(region, Box):
        return BOX, np.array([*region.lower, *region.upper], float)
    return CONE, np.array([*region.base, region.height, region.lower_radius, region.upper_radius], float)


def _empty_cells(region: Region, top: float, radius: Floats) -> Cells:
    """A grid over the region up to `top`, wide enough for spheres that only reach into it."""
    largest = float(radius.max())
    bounds = region.bounds
    origin = np.array(bounds.lower) - 2.0 * largest
    extent = np.array([bounds.upper[0], bounds.upper[1], top]) + 2.0 * largest - origin
    # A cell of the mean diameter keeps the chains short whatever the size ratio.
    fewest = float(np.prod(extent)) / (CELLS_PER_SPHERE * len(radius) + 4096)
    size = max(2.0 * float(radius.mean()), fewest ** (1.0 / 3.0))
    dims = (extent / size).astype(np.int64) + 1
    return Cells(
        np.full(tuple(dims), -1, np.int64), np.full(len(radius), -1, np.int64), origin, size, largest
    )


def _loose_top(region: Region, volume: float, largest: float) -> float:
    """Height z, m, below which a region holds `volume` (m3) of spheres loosely."""
    lower, upper = region.bottom, region.top
    for _ in range(60):
        middle = 0.5 * (lower + upper)
        if region.volume_below(middle) * LOOSE_FRACTION < volume:
            lower = middle
        else:
            upper = middle
    return min(upper + 2.0 * largest, region.top)


def fill_region(
    region: Region,
    radius: Floats,
    rng: np.random.Generator,
    walls: Walls,
    taken_position: Floats | None = None,
    taken_radius: Floats | None = None,
) -> Floats:
    """Positions (N, 3), m, for spheres of radii (N,) inside a region, as low as they find room.

    None overlaps another, one of those there already (`taken_*`), or a wall that is there at the start. Raises
    InputError when the region cannot hold them loosely, and says how many it does hold.
    """
    place, size = _near(region, float(radius.max()), taken_position, taken_radius)
    order = np.argsort(-radius, kind="stable")
    sizes = np.concatenate([size, radius[order]])
    largest = float(radius.max())
    kind, shape = _shape(region)
    top = _loose_top(region, 4.0 / 3.0 * math.pi * float((radius**3).sum()), largest)
    seed = int(rng.integers(2**31))
    present = walls_at(walls, 0, 1.0)
    while True:
        position = np.concatenate([place, np.zeros((len(radius), 3))])
        cells = _empty_cells(region, top, sizes)
        found = place_spheres(
            kind, shape, top, position, sizes, len(size), walls, present, cells, seed
        ) - len(size)
        if found == len(radius):
            break
        if top >= region.top:
            held = float((radius[order][:found] ** 3).sum() / (radius**3).sum())
            raise InputError(
                "fill.region",
                region,
                f"room for {len(radius)} loose particles; {found} found a place, {held:.0%} of the volume "
                "(make the region taller, or fill less)",
            )
        top = min(region.bottom + 1.1 * (top - region.bottom), region.top)
    result = np.empty((len(radius), 3))
    result[order] = position[len(size) :]
    return result


def _near(
    region: Region, reach: float, position: Floats | None, radius: Floats | None
) -> tuple[Floats, Floats]:
    """Those of the spheres there already that a new one inside the region could touch."""
    if position is None or radius is None:
        return np.zeros((0, 3)), np.zeros(0)
    lower, upper = np.array(region.bounds.lower), np.array(region.bounds.upper)
    margin = (radius + reach)[:, None]
    close = ((position > lower - margin) & (position < upper + margin)).all(axis=1)
    return position[close], radius[close]


def fill_cylinder(radius: Floats, cylinder_radius: float, rng: np.random.Generator) -> Floats:
    """Positions (N, 3), m, of spheres in a loose column above z = 0 inside a cylinder, none overlapping.

    Raises InputError for a particle that is larger than the cylinder.
    """
    largest = float(radius.max())
    if largest > cylinder_radius:
        allowed = f"particles of at most {2.0 * cylinder_radius:g} m, the cylinder's diameter"
        raise InputError("radius", largest * 2.0, allowed)
    # As high as one sphere on top of the other: enough for any column.
    height = float(2.0 * radius.sum()) + 2.0 * largest
    return fill_region(cylinder((0.0, 0.0, 0.0), cylinder_radius, height), radius, rng, wall_arrays(()))


@kernel
def choose_places(
    points: Floats,
    radius: Floats,
    position: Floats,
    size: Floats,
    there: int,
    walls: Walls,
    present: NDArray[np.bool_],
    patience: int,
) -> NDArray[np.int64]:
    """For each of K spheres the first of its points (K, A, 3) that is free, -1 for none; in order, so that each
    sees those before it. `position` and `size` hold `there` spheres and have room for K more. After `patience`
    spheres without a place the others are not tried."""
    chosen = np.full(len(radius), -1, np.int64)
    missed = 0
    for k in range(len(radius)):
        if missed >= patience:
            break
        r = radius[k]
        for a in range(points.shape[1]):
            x, y, z = points[k, a, 0], points[k, a, 1], points[k, a, 2]
            free = not touches_wall(x, y, z, r, walls, present)
            j = 0
            while free and j < there:
                dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
                free = dx * dx + dy * dy + dz * dz >= (r + size[j]) ** 2
                j += 1
            if free:
                chosen[k] = a
                position[there] = points[k, a]
                size[there] = r
                there += 1
                break
        missed += chosen[k] < 0
    return chosen

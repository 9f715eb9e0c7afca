"""Whether grains can come through the feeder's opening at all: its place, and how far the walls are from it.

Plain numpy, so that a charge can be refused where nothing is compiled; a run has its own way (insertion.py).

Notation: of a surface of revolution rho is the distance of a point from its axis and h the height along it; its
distance to the surface is that to the segment (r0, 0) to (r1, length) in the half plane of rho and h.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from demcore.errors import InputError
from demcore.geometry.mesh import TriangleMesh
from demcore.geometry.walls import Wall
from demcore.plant.parts import Plant
from demcore.plant.surfaces import plant_walls
from demcore.region import RectangleInlet

Floats = NDArray[np.float64]

# Places across the inlet at which the largest grain is tried.
INLET_GRID = 9


def feed_inlet(plant: Plant) -> RectangleInlet:
    """The opening above the belt's tail, level across and tilted like the belt."""
    belt, f = plant.belt, plant.feeder
    running, normal = np.array(belt.running), np.array(belt.normal)
    upstream = belt.loaded_length - 0.5 * f.length
    centre = np.array(belt.tangent_point) - upstream * running + f.drop * normal
    half = 0.5 * f.length * running
    return RectangleInlet(
        (float(centre[0]), float(centre[1]), float(centre[2])),
        (float(half[0]), float(half[1]), float(half[2])),
        (0.0, 0.5 * f.width, 0.0),
    )


def check_inlet(plant: Plant, largest_diameter: float, inlet: RectangleInlet) -> None:
    """Raises InputError when the largest grain, anywhere in the inlet, would be born inside a wall."""
    radius = 0.5 * largest_diameter
    if radius > inlet.largest_radius:
        room = f"there is {2.0 * inlet.largest_radius:g} m"
        allowed = f"room for the largest grain, {largest_diameter:g} m across; {room}"
        raise InputError("feeder", f"{plant.feeder.length:g} m by {plant.feeder.width:g} m", allowed)
    share = (np.arange(INLET_GRID) + 0.5) / INLET_GRID
    points = inlet.points(np.array([(a, b) for a in share for b in share]), radius)
    for wall in plant_walls(plant):
        touched = distance_to_wall(points, wall, radius) < radius
        if touched.any():
            x, y, z = points[int(touched.argmax())]
            place = f"({x:.3f}, {y:.3f}, {z:.3f}) m"
            grain = f"a grain of {largest_diameter:g} m at {place}"
            allowed = f"an inlet clear of walls: {grain} touches the {wall.name}"
            raise InputError("feeder.drop", plant.feeder.drop, allowed)


def distance_to_wall(points: Floats, wall: Wall, reach: float) -> Floats:
    """(P,) distances, m, of points (P, 3) to a mesh, cylinder or cone; inf may stand for beyond `reach`."""
    place = points - np.array(wall.centre)
    if wall.mesh is not None:
        return distance_to_mesh(place, wall.mesh, reach)
    axis = np.array(wall.axis) / np.sqrt((np.array(wall.axis) ** 2).sum())
    h = place @ axis
    rho = np.sqrt(np.maximum((place**2).sum(axis=1) - h * h, 0.0))
    start = np.array([wall.radius, 0.0])
    way = np.array([wall.end_radius if wall.kind == "cone" else wall.radius, wall.length]) - start
    offset = np.column_stack([rho, h]) - start
    along = np.clip(offset @ way / float(way @ way), 0.0, 1.0)
    return np.asarray(np.hypot(*(offset - along[:, None] * way).T), np.float64)


def distance_to_mesh(points: Floats, mesh: TriangleMesh, reach: float) -> Floats:
    """(P,) distances, m, to the nearest triangle whose box comes within `reach` of the points' own; else inf."""
    # Here, because it takes a second to import, which a process that charges nothing need not wait.
    import trimesh

    corners = mesh.corners()
    lower, upper = points.min(axis=0) - reach, points.max(axis=0) + reach
    near = corners[(corners.max(axis=1) >= lower).all(axis=1) & (corners.min(axis=1) <= upper).all(axis=1)]
    nearest = np.full(len(points), np.inf)
    for k, point in enumerate(points):
        if len(near):
            closest = trimesh.triangles.closest_point(near, np.tile(point, (len(near), 1)))  # type: ignore[no-untyped-call]
            nearest[k] = np.sqrt(((closest - point) ** 2).sum(axis=1)).min()
    return nearest

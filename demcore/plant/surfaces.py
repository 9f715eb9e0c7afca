"""The plant's walls: analytic where a surface is one of revolution, triangles for belt, lid and deflector."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from demcore.geometry.mesh import TriangleMesh
from demcore.geometry.walls import Wall
from demcore.plant.parts import Belt, Deflector, Plant

Floats = NDArray[np.float64]

LID_SIDES = 64
TRANSITION_STATIONS = 8
# Pieces of the lid narrower than this share of their length are slivers of a cut, m2.
SMALLEST_PIECE = 1e-9
HOPPER, CONE, BELL, ROD, LID, DEFLECTOR, SKIRT, BELT, DRUM = (
    "hopper",
    "hopper cone",
    "bell",
    "rod",
    "lid",
    "deflector",
    "skirt",
    "belt",
    "drum",
)


def plant_walls(plant: Plant) -> tuple[Wall, ...]:
    """All walls, named by part; a replaced part is its mesh. The belt runs, the drum turns with it."""
    belt = plant.belt
    running = tuple(belt.speed * c for c in belt.running)
    own = {
        HOPPER: _hopper(plant),
        BELL: (_bell(plant),),
        ROD: (_rod(plant),),
        LID: (Wall("mesh", mesh=lid_mesh(plant), name=LID),),
        DEFLECTOR: (Wall("mesh", mesh=deflector_mesh(plant.deflector), name=DEFLECTOR),),
        SKIRT: (Wall("mesh", mesh=skirt_mesh(plant), name=SKIRT),),
        BELT: (Wall("mesh", mesh=belt_mesh(belt), surface_velocity=running, name=BELT),),  # type: ignore[arg-type]
    }
    for replacement in plant.replacements:
        velocity = running if replacement.part == BELT else (0.0, 0.0, 0.0)
        mesh = Wall("mesh", mesh=replacement.mesh, surface_velocity=velocity, name=replacement.part)  # type: ignore[arg-type]
        own[replacement.part] = (mesh,)
    return (*(wall for walls in own.values() for wall in walls), drum_wall(belt))


def _hopper(plant: Plant) -> tuple[Wall, Wall]:
    h = plant.hopper
    tube = Wall(
        "cylinder", (0.0, 0.0, -h.cylinder_height), radius=h.rim_radius, length=h.cylinder_height, name=HOPPER
    )
    seat = (0.0, 0.0, -h.seat_depth)
    cone = Wall("cone", seat, radius=h.seat_radius, end_radius=h.rim_radius, length=h.cone_height, name=CONE)
    return tube, cone


def _bell(plant: Plant) -> Wall:
    seat = (0.0, 0.0, -plant.hopper.seat_depth)
    radius, top = plant.hopper.seat_radius, plant.rod.radius
    return Wall("cone", seat, radius=radius, end_radius=top, length=plant.bell_height, name=BELL)


def _rod(plant: Plant) -> Wall:
    foot = (0.0, 0.0, plant.bell_top)
    return Wall("cylinder", foot, radius=plant.rod.radius, length=plant.rod.top - plant.bell_top, name=ROD)


def drum_wall(belt: Belt) -> Wall:
    """The belt's surface round the drum, turning with it."""
    x, y, z = belt.drum_centre
    return Wall(
        "cylinder",
        (x, y - 0.5 * belt.width, z),
        (0.0, 1.0, 0.0),
        radius=belt.outer_radius,
        length=belt.width,
        angular_velocity=(0.0, belt.speed / belt.outer_radius, 0.0),
        name=DRUM,
    )


def deflector_mesh(deflector: Deflector) -> TriangleMesh:
    """Two rectangles that share the ridge."""
    d, turn = deflector, math.radians(deflector.rotation_deg)
    across = np.array([math.cos(turn), math.sin(turn), 0.0])
    along = np.array([-math.sin(turn), math.cos(turn), 0.0])
    down = np.array([0.0, 0.0, -1.0])
    middle = np.array([d.ridge_across, d.ridge_along, d.ridge_height])
    ridge = np.array([middle - 0.5 * d.edge_length * along, middle + 0.5 * d.edge_length * along])
    near, far = (math.radians(p) for p in (d.near_pitch_deg, d.far_pitch_deg))
    near_edge = ridge + d.face_length * (-math.cos(near) * across + math.sin(near) * down)
    far_edge = ridge + d.face_length * (math.cos(far) * across + math.sin(far) * down)
    vertices = np.concatenate([ridge, near_edge, far_edge])
    # Corners counter-clockwise seen from above.
    faces = np.array([[0, 1, 3], [0, 3, 2], [1, 0, 4], [1, 4, 5]])
    return TriangleMesh(vertices, faces)


def belt_profile(belt: Belt, upstream: float) -> Floats:
    """(4, 2) offsets across and above the belt's middle plane, m, of its section so far before the drum, m."""
    strip = belt.width / 3.0
    raised = math.radians(belt.trough_deg) * min(upstream / belt.transition_length, 1.0)
    edge, lift = 0.5 * strip + strip * math.cos(raised), strip * math.sin(raised)
    return np.array([[-edge, lift], [-0.5 * strip, 0.0], [0.5 * strip, 0.0], [edge, lift]])


def belt_mesh(belt: Belt) -> TriangleMesh:
    """Three strips that flatten out on the transition and end where the belt meets the drum."""
    flat = np.linspace(0.0, belt.transition_length, TRANSITION_STATIONS + 1)
    stations = [*(float(s) for s in flat), belt.loaded_length]
    points = [_section(belt, s, belt_profile(belt, s)) for s in stations]
    faces = []
    for k in range(len(stations) - 1):
        for strip in range(3):
            a, b = 4 * k + strip, 4 * k + strip + 1
            faces += [[a, b, a + 4], [b, b + 4, a + 4]]
    return TriangleMesh(np.concatenate(points), np.array(faces))


def skirt_mesh(plant: Plant) -> TriangleMesh:
    """Two boards at right angles to the belt's middle, on its edges, along the loading point."""
    belt, f = plant.belt, plant.feeder
    foot = belt_profile(belt, belt.loaded_length)[[0, 3]]
    head = foot + np.array([0.0, f.skirt_height])
    tail, end = belt.loaded_length, belt.loaded_length - f.skirt_length
    # Rows: foot and head of the first board at the tail, then at its end; then the second board's.
    boards = [
        np.concatenate([_section(belt, s, np.array([foot[k], head[k]])) for s in (tail, end)]) for k in (0, 1)
    ]
    faces = np.array([[0, 1, 3], [0, 3, 2]])
    return TriangleMesh(np.concatenate(boards), np.concatenate([faces, faces + 4]))


def _section(belt: Belt, upstream: float, profile: Floats) -> Floats:
    """(K, 3) points of a profile so far before the drum."""
    middle = np.array(belt.tangent_point) - upstream * np.array(belt.running)
    across, above = np.array([0.0, 1.0, 0.0]), np.array(belt.normal)
    return np.asarray(middle + profile[:, :1] * across + profile[:, 1:] * above, np.float64)


def lid_mesh(plant: Plant) -> TriangleMesh:
    """The lid's cone of LID_SIDES flat sides, less the hatch cut out straight down."""
    angles = 2.0 * np.pi * np.arange(LID_SIDES + 1) / LID_SIDES
    circle = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(LID_SIDES + 1)])
    up = np.array([0.0, 0.0, plant.lid.height])
    outer, inner = plant.hopper.rim_radius * circle, plant.lid.inner_radius * circle + up
    lower, upper = np.array(plant.hatch.lower), np.array(plant.hatch.upper)
    corners = []
    for k in range(LID_SIDES):
        side = np.array([outer[k], outer[k + 1], inner[k + 1], inner[k]])
        for piece in outside_rectangle(side, lower, upper):
            fan = [np.stack([piece[0], piece[j], piece[j + 1]]) for j in range(1, len(piece) - 1)]
            corners += [t for t in fan if _area(t) > SMALLEST_PIECE]
    points = np.concatenate(corners)
    vertices, row = np.unique(np.round(points, 12), axis=0, return_inverse=True)
    return TriangleMesh(vertices, row.reshape(-1, 3))


def outside_rectangle(polygon: Floats, lower: Floats, upper: Floats) -> list[Floats]:
    """Convex pieces of a convex polygon (K, 3) that lie, in plan, outside a rectangle in x and y."""
    pieces, rest = [], polygon
    for axis in (0, 1):
        for sign, bound in ((-1.0, lower[axis]), (1.0, upper[axis])):
            beyond = sign * (rest[:, axis] - bound)
            outside, rest = _half(rest, beyond), _half(rest, -beyond)
            if len(outside) >= 3:
                pieces.append(outside)
            if len(rest) < 3:
                return pieces
    return pieces


def _half(polygon: Floats, beyond: Floats) -> Floats:
    """The part of a convex polygon where `beyond` (K,), linear on it, is not negative."""
    kept = []
    for a, b, p, q in zip(beyond, np.roll(beyond, -1), polygon, np.roll(polygon, -1, axis=0), strict=True):
        if a >= 0.0:
            kept.append(p)
        if a * b < 0.0:
            kept.append(p + (q - p) * a / (a - b))
    return np.array(kept).reshape(-1, 3)


def _area(triangle: Floats) -> float:
    cross = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    return 0.5 * math.sqrt(float(cross @ cross))

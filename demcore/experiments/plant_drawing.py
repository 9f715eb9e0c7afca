"""The plant from three sides with its jet, drawn before anything runs, and every number with its reason."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from demcore.canvas import FRONT, GREY, INK, SIDE, TOP, Canvas, Colour, Frame, View, fit_frame
from demcore.geometry.wall_arrays import wall_arrays
from demcore.picture import save_png
from demcore.plant import jet
from demcore.plant.parts import Plant
from demcore.plant.surfaces import BELT, DEFLECTOR, DRUM, LID, SKIRT, plant_walls
from demcore.recorder import wall_arrays_of

Floats = NDArray[np.float64]

WIDTH, HEIGHT = 1500, 1180
BLUE: Colour = (40, 110, 190)
RED: Colour = (200, 60, 50)
COLOURS: dict[str, Colour] = {DEFLECTOR: RED, BELT: BLUE, DRUM: BLUE, LID: GREY, SKIRT: GREY}
# Heights above the belt whose jets are drawn, m.
JET_HEIGHTS = (0.0, 0.1)


def wall_outlines(plant: Plant) -> list[tuple[str, Floats, NDArray[np.int64]]]:
    """Name, points (P, 3) m and triangles (T, 3) of every wall."""
    walls = plant_walls(plant)
    arrays = wall_arrays_of(wall_arrays(walls), np.array([0.0, 0.0, 0.0, 1.0]), 0, 1.0)
    points = arrays["wall_points"].astype(np.float64)
    found = []
    for k, wall in enumerate(walls):
        triangles = arrays["wall_triangles"][arrays["wall_number"] == k]
        found.append((wall.name, points, triangles))
    return found


def draw_walls(canvas: Canvas, frame: Frame, plant: Plant, left_out: tuple[str, ...] = ()) -> None:
    """All walls but those left out."""
    for name, points, triangles in wall_outlines(plant):
        if name not in left_out:
            used, row = np.unique(triangles, return_inverse=True)
            canvas.outlines(frame, points[used], row.reshape(-1, 3), COLOURS.get(name, INK))


def jet_line(plant: Plant, height: float) -> Floats:
    """(N, 3) points, m, of a grain's way from `height` above the belt at the drum down to the bell's seat."""
    start, y = jet.release(plant.belt, height), plant.belt.drum_centre[1]
    times = np.linspace(0.0, jet.fall_time(start, -plant.hopper.seat_depth), 60)
    return np.array([(x, y, z) for x, z in (jet.position(start, float(t)) for t in times)])


def plant_box(plant: Plant) -> tuple[Floats, Floats]:
    """Lower and upper corner of everything, m."""
    points = np.concatenate([points[np.unique(triangles)] for _, points, triangles in wall_outlines(plant)])
    return points.min(axis=0), points.max(axis=0)


def draw_plant(plant: Plant, path: Path) -> None:
    """Write the three views as PNG."""
    canvas = Canvas(WIDTH, HEIGHT)
    lower, upper = plant_box(plant)
    places: tuple[tuple[View, tuple[int, int, int, int]], ...] = (
        (FRONT, (0, 30, 900, 600)),
        (SIDE, (900, 30, 600, 600)),
        (TOP, (0, 630, 900, 550)),
    )
    canvas.words(8, 6, "Charging plant: belt and drum blue, deflector red, the jet's closed form dashed", 16)
    for view, place in places:
        frame = fit_frame(view, place, lower, upper)
        draw_walls(canvas, frame, plant)
        for height in JET_HEIGHTS:
            _dashed(canvas, frame, jet_line(plant, height))
        _mark_reference(canvas, frame)
        canvas.caption(frame, view.name)
    _table(canvas, plant, 915, 645)
    save_png(canvas.image, path)


def _dashed(canvas: Canvas, frame: Frame, points: Floats) -> None:
    for k in range(0, len(points) - 1, 2):
        canvas.line(frame, points[k : k + 2], (90, 160, 60), 2)


def _mark_reference(canvas: Canvas, frame: Frame) -> None:
    arm = 0.12
    for axis in range(3):
        ends = np.zeros((2, 3))
        ends[:, axis] = (-arm, arm)
        canvas.line(frame, ends, RED, 2)
    canvas.label(frame, np.zeros(3), "reference point", RED)


def _table(canvas: Canvas, plant: Plant, x: int, y: int) -> None:
    """The published and the assumed numbers, most of what a reader would ask for."""
    belt, d = plant.belt, plant.deflector
    start = jet.release(belt)
    at_lid = jet.crossing(plant)
    drum = f"{1e3 * belt.drum_across:g}, {1e3 * belt.drum_along:g}, {1e3 * belt.drum_height:g}"
    rows = (
        f"drum centre from the reference point (across, along, up): {drum} mm",
        f"drum {1e3 * belt.drum_diameter:g} mm, belt {1e3 * belt.thickness:g} mm thick, {belt.speed:g} m/s, "
        f"tilt {belt.tilt_deg:g} deg (all published)",
        f"jet leaves {start.angle_deg:.1f} deg past the top, at the lid x {at_lid[0]:.2f}, y {at_lid[1]:.2f} m",
        f"belt {1e3 * belt.width:g} mm wide, trough {belt.trough_deg:g} deg, {belt.loaded_length:g} m modelled",
        f"hatch {1e3 * plant.hatch.length:g} x {1e3 * plant.hatch.width:g} mm",
        f"hopper rim {2 * plant.hopper.rim_radius:g} m, seat {2 * plant.hopper.seat_radius:g} m, "
        f"{plant.hopper.seat_depth:g} m deep, bell {plant.bell.slope_deg:g} deg",
        f"deflector pitches near {d.near_pitch_deg:g}, far {d.far_pitch_deg:g} deg, rot. {d.rotation_deg:g} deg,",
        f"  ridge at x {d.ridge_across:g}, y {d.ridge_along:g}, z {d.ridge_height:g} m, "
        f"edge {d.edge_length:g} m, face {d.face_length:g} m",
        *(f"{r.part}: mesh of {r.file}, {len(r.mesh)} triangles" for r in plant.replacements),
        "green: a grain on the belt, and one .1 m above it turning with the drum",
    )
    for k, row in enumerate(rows):
        canvas.words(x, y + 20 * k, row, 13)

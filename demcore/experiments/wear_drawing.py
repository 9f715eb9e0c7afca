"""The picture of what a hopper's walls bear: flat maps of bell and deflector from above, and of the wall unrolled.

Notation: a map is values (A, B) on a grid, with a colour by the logarithm over DECADES below its largest value.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from demcore.canvas import GREY, TOP, Canvas, Frame, fit_frame
from demcore.experiments.charge_result import ChargeResult
from demcore.experiments.plant_drawing import draw_walls
from demcore.observables.wear import CELL
from demcore.picture import save_png, shades
from demcore.plant.parts import Plant
from demcore.plant.surfaces import BELL, BELT, CONE, DEFLECTOR, DRUM, HOPPER, LID, ROD, SKIRT

Floats = NDArray[np.float64]

WIDTH, HEIGHT, COLUMN = 1500, 1180, 750
# What is a thousandth of the largest is bare.
DECADES = 3.0
# Of the wall unrolled: sectors round it, place of its left upper corner, and its size, pixels.
ROUND = 72
WALL_LEFT, WALL_TOP, WALL_WIDTH, WALL_HEIGHT = 60, 740, 630, 340


def draw_wear(result: ChargeResult, path: Path) -> None:
    """Energy of the strikes on the left, load at the end on the right."""
    canvas = Canvas(WIDTH, HEIGHT)
    wall, place, values = result.wear.rows()
    names = np.array([w.name for w in result.test.case.walls] or [""])[wall]
    columns = (("energy of strikes", "J", values[:, 0]), ("load at the end", "N", values[:, 2]))
    for k, (quantity, unit, value) in enumerate(columns):
        x = COLUMN * k
        highest = _highest(result.test.plant, names, place, value)
        canvas.words(x + 14, 8, f"{quantity}: bell, rod and, above them, deflector", 16)
        _draw_plan(canvas, result.test.plant, x, (names, place, value), highest)
        canvas.words(x + 14, WALL_TOP - 28, f"{quantity}: the hopper's wall unrolled, by azimuth", 16)
        _draw_wall(canvas, result.test.plant, x, (names, place, value), highest)
        low = highest * 10.0**-DECADES
        canvas.colour_scale(x + 60, HEIGHT - 44, f"{unit} in a cell of {CELL:g} m, log scale", low, highest)
    save_png(canvas.image, path)


def plan_map(
    names: NDArray[np.str_], place: Floats, value: Floats, walls: tuple[str, ...]
) -> dict[tuple[int, int], float]:
    """The sum over height of what the named walls bear, by cell in x and y."""
    chosen = np.isin(names, walls) & (value > 0.0)
    cells = np.floor(place[chosen, :2] / CELL).astype(np.int64)
    found: dict[tuple[int, int], float] = {}
    for (i, j), v in zip(cells.tolist(), value[chosen].tolist(), strict=True):
        found[i, j] = found.get((i, j), 0.0) + v
    return found


def wall_map(plant: Plant, names: NDArray[np.str_], place: Floats, value: Floats) -> Floats:
    """(ROUND, rows) what the hopper's wall bears by azimuth from 0 and height from the seat up."""
    rows = math.ceil(plant.hopper.seat_depth / CELL)
    chosen = np.isin(names, (HOPPER, CONE)) & (value > 0.0)
    azimuth = np.arctan2(place[chosen, 1], place[chosen, 0]) % (2.0 * np.pi)
    i = (azimuth / (2.0 * np.pi) * ROUND).astype(np.int64) % ROUND
    j = np.clip(((place[chosen, 2] + plant.hopper.seat_depth) / CELL).astype(np.int64), 0, rows - 1)
    found = np.zeros((ROUND, rows))
    np.add.at(found, (i, j), value[chosen])
    return found


def _highest(plant: Plant, names: NDArray[np.str_], place: Floats, value: Floats) -> float:
    """Of all maps of one quantity, so that their colours compare."""
    plans = [plan_map(names, place, value, walls) for walls in ((BELL, ROD), (DEFLECTOR,))]
    highest = max((v for plan in plans for v in plan.values()), default=0.0)
    return max(highest, float(wall_map(plant, names, place, value).max(initial=0.0))) or 1.0


def _colour(value: float, highest: float) -> tuple[int, int, int]:
    share = 1.0 + math.log10(max(value / highest, 1e-30)) / DECADES
    red, green, blue = (int(c) for c in shades(np.array([share]))[0])
    return red, green, blue


def _draw_plan(
    canvas: Canvas, plant: Plant, x: int, seen: tuple[NDArray[np.str_], Floats, Floats], highest: float
) -> None:
    rim = plant.hopper.rim_radius
    box = np.array([-rim, -rim, -plant.hopper.seat_depth]), np.array([rim, rim, 0.1])
    frame = fit_frame(TOP, (x, 30, COLUMN, 670), *box)
    for walls in ((BELL, ROD), (DEFLECTOR,)):
        for cell, value in plan_map(*seen, walls).items():
            _draw_cell(canvas, frame, cell, _colour(value, highest))
    draw_walls(canvas, frame, plant, (LID, SKIRT, BELT, DRUM))
    canvas.caption(frame, "from above: x, y")


def _draw_cell(canvas: Canvas, frame: Frame, cell: tuple[int, int], colour: tuple[int, int, int]) -> None:
    corner = frame.project(np.array([[CELL * cell[0], CELL * (cell[1] + 1), 0.0]]))[0]
    side = CELL * frame.pixels_per_m
    canvas.box(frame.x + corner[0], frame.y + corner[1], side, side, colour)


def _draw_wall(
    canvas: Canvas, plant: Plant, x: int, seen: tuple[NDArray[np.str_], Floats, Floats], highest: float
) -> None:
    values, left = wall_map(plant, *seen), x + WALL_LEFT
    wide, high = WALL_WIDTH / ROUND, WALL_HEIGHT / values.shape[1]
    for i, j in np.argwhere(values > 0.0).tolist():
        colour = _colour(float(values[i, j]), highest)
        canvas.box(left + i * wide, WALL_TOP + WALL_HEIGHT - (j + 1) * high, wide, high, colour)
    right, bottom = left + WALL_WIDTH, WALL_TOP + WALL_HEIGHT
    border: list[tuple[float, float]] = [(left, WALL_TOP), (right, WALL_TOP), (right, bottom), (left, bottom)]
    canvas.strip([*border, border[0]], GREY, 1)
    knee = WALL_TOP + WALL_HEIGHT * plant.hopper.cylinder_height / plant.hopper.seat_depth
    canvas.strip([(left, knee), (right, knee)], GREY, 1)
    for quarter in range(5):
        canvas.words(left + quarter * WALL_WIDTH / 4 - 12, bottom + 4, f"{90 * quarter} deg", 12)
    canvas.words(left - 44, WALL_TOP - 6, "rim", 12)
    canvas.words(left - 44, knee - 8, "cone", 12)
    canvas.words(left - 44, bottom - 12, "seat", 12)

"""The pictures of a charge: the burden from above and from the side, by height and by size, and its curves."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from demcore.canvas import FRONT, GREY, INK, SIDE, TOP, Canvas, Colour, fit_frame
from demcore.experiments.charge_result import ChargeResult
from demcore.experiments.plant_drawing import draw_walls, jet_line, plant_box
from demcore.experiments.wear_drawing import draw_wear
from demcore.observables.belt_flow import CELL
from demcore.picture import save_png, shades
from demcore.plant.surfaces import BELT as BELT_WALL
from demcore.plant.surfaces import DRUM, LID, SKIRT, belt_profile

Floats = NDArray[np.float64]

WIDTH = 1500
GREEN: Colour = (60, 140, 70)
RED: Colour = (200, 60, 50)
BLUE: Colour = (40, 110, 190)


def by_value(values: Floats) -> tuple[Floats, float, float]:
    """(N, 3) colours and the ends of the scale, the 2 and 98 % quantiles."""
    low, high = (float(q) for q in np.quantile(values, (0.02, 0.98))) if len(values) else (0.0, 1.0)
    return shades((values - low) / max(high - low, 1e-9)), low, high


def draw_burden(result: ChargeResult, path: Path) -> None:
    """The burden by height (left) and by size (right), from above and from the front."""
    canvas = Canvas(WIDTH, 1290)
    plant, inside = result.test.plant, result.in_hopper
    position, radius = result.positions[inside], result.radii[inside]
    rim, depth = plant.hopper.rim_radius, plant.hopper.seat_depth
    lower, upper = np.array([-rim, -rim, -depth]), np.array([rim, rim, 0.1])
    title = f"{result.test.charge.name}, scale {result.test.scale:g}, seed {result.test.seed}: "
    canvas.words(
        8, 6, title + f"{result.masses[inside].sum():.0f} kg in the hopper, {inside.sum()} grains", 16
    )
    columns = (("height z / m", position[:, 2] + radius), ("diameter / m", 2.0 * radius))
    for k, (name, values) in enumerate(columns):
        colours, low, high = by_value(values)
        for view, place in ((TOP, (750 * k, 30, 750, 700)), (FRONT, (750 * k, 730, 750, 500))):
            frame = fit_frame(view, place, lower, upper)
            canvas.spheres(frame, position, radius, colours)
            draw_walls(canvas, frame, plant, (LID, SKIRT, BELT_WALL, DRUM))
            canvas.caption(frame, view.name)
            if view is TOP:
                for n, pile in enumerate(result.piles):
                    angle = math.radians(pile.azimuth_deg)
                    top = np.array([pile.radius * math.cos(angle), pile.radius * math.sin(angle), 0.0])
                    canvas.label(frame, top, f"pile {n + 1}", RED)
        canvas.colour_scale(750 * k + 20, 1240, name, low, high)
    save_png(canvas.image, path)


def draw_charge(result: ChargeResult, path: Path) -> None:
    """Everything from two sides at the end, coloured by size, with the jet's closed form."""
    canvas = Canvas(WIDTH, 700)
    colours, low, high = by_value(2.0 * result.radii)
    lower, upper = plant_box(result.test.plant)
    for view, place in ((FRONT, (0, 0, 900, 640)), (SIDE, (900, 0, 600, 640))):
        frame = fit_frame(view, place, lower, upper)
        canvas.spheres(frame, result.positions, result.radii, colours)
        draw_walls(canvas, frame, result.test.plant)
        canvas.line(frame, jet_line(result.test.plant, 0.0), GREEN)
        canvas.caption(frame, view.name)
    canvas.colour_scale(20, 650, "diameter / m", low, high)
    save_png(canvas.image, path)


def draw_curves(result: ChargeResult, path: Path) -> None:
    """By sector: height, mass, size; over time: where the mass is; the belt's section; the jet."""
    canvas = Canvas(WIDTH, 1000)
    s, t = result.sectors, np.array([a.time for a in result.accounts])
    seat = -result.test.plant.hopper.seat_depth
    _plot(
        canvas, (0, 0), "height above the seat by azimuth / m, deg", s.azimuth_deg, [(s.height - seat, INK)]
    )
    _plot(canvas, (500, 0), "mass by azimuth / kg, deg", s.azimuth_deg, [(s.mass, INK)])
    _plot(canvas, (1000, 0), "mean diameter by azimuth / m, deg", s.azimuth_deg, [(s.size, INK)])
    curves = [
        (np.array([a.in_hopper for a in result.accounts]), INK),
        (np.array([a.on_belt for a in result.accounts]), BLUE),
        (np.array([a.lost for a in result.accounts]), RED),
    ]
    _plot(canvas, (0, 330), "in the hopper (black), on the belt (blue), lost (red) / kg, s", t, curves)
    level = np.array([a.level for a in result.accounts])
    there = np.isfinite(level)
    _plot(canvas, (500, 330), "mean level of the burden z / m, s", t[there], [(level[there], INK)])
    heights, share, size = result.section.size_by_height()
    laid = share > 0.002
    _plot(
        canvas,
        (1000, 330),
        "mean diameter over height on the belt / m, m",
        heights[laid],
        [(size[laid], INK)],
    )
    _draw_section(canvas, result, 0, 660)
    q = result.jet.quantiles()
    passed = np.isfinite(q[:, 1])
    jets: list[tuple[Floats, Colour]] = [(q[passed, 0], GREY), (q[passed, 1], INK), (q[passed, 2], GREY)]
    _plot(
        canvas, (750, 660), "jet: x of 5, 50, 95 % of the mass over z / m, m", result.jet.levels[passed], jets
    )
    save_png(canvas.image, path)


def _plot(
    canvas: Canvas, corner: tuple[int, int], title: str, x: Floats, curves: list[tuple[Floats, Colour]]
) -> None:
    """Lines over x in a box of 500 by 330 pixels, with the ends of both axes."""
    left, top, width, height = corner[0] + 70, corner[1] + 34, 400, 250
    canvas.words(corner[0] + 14, corner[1] + 8, title, 14)
    values = np.concatenate([y for y, _ in curves]) if curves else np.zeros(0)
    values = values[np.isfinite(values)]
    if len(x) < 2 or not len(values):
        return
    low, high = min(float(values.min()), 0.0), float(values.max())
    if high - low < 1e-12:
        high = low + 1.0
    first, last = float(x.min()), float(x.max())
    frame: list[tuple[float, float]] = [(left, top), (left, top + height), (left + width, top + height)]
    canvas.strip(frame, GREY, 1)
    for y, colour in curves:
        good = np.isfinite(y)
        across = left + (x[good] - first) / (last - first) * width
        down = top + height - (y[good] - low) / (high - low) * height
        canvas.strip(list(zip(across.tolist(), down.tolist(), strict=True)), colour)
    canvas.words(left - 62, top - 6, f"{high:.4g}", 12)
    canvas.words(left - 62, top + height - 8, f"{low:.4g}", 12)
    canvas.words(left, top + height + 4, f"{first:.4g}", 12)
    canvas.words(left + width - 30, top + height + 4, f"{last:.4g}", 12)


def _draw_section(canvas: Canvas, result: ChargeResult, x: int, y: int) -> None:
    """The bed in the trough: cells shaded by mean diameter, the belt below, as large as the frame takes."""
    section = result.section
    canvas.words(x + 14, y + 8, "section through the belt, shaded by mean diameter", 14)
    with np.errstate(invalid="ignore", divide="ignore"):
        size = section.moment / section.mass
    there = section.mass > 0.002 * section.mass.max() if section.samples else np.zeros(section.shape, bool)
    if not there.any():
        return
    colours, low, high = by_value(size[there])
    # Grains that still jump stand high above the bed, and must not stand in the title.
    scale = min(800.0, 245.0 / (CELL * float(np.argwhere(there)[:, 1].max() + 1)))
    left, ground = x + 40, y + 290
    for (i, j), colour in zip(np.argwhere(there), colours, strict=True):
        red, green, blue = (int(c) for c in colour)
        cell = CELL * scale
        canvas.box(left + i * cell, ground - (j + 1) * cell, cell, cell, (red, green, blue))
    profile = belt_profile(result.test.plant.belt, 2.0 * result.test.plant.belt.transition_length)
    line = [(left + (a + section.half_width) * scale, ground - h * scale) for a, h in profile.tolist()]
    canvas.strip(line, BLUE, 3)
    canvas.colour_scale(x + 40, y + 300, "diameter / m", low, high)


def draw_all(result: ChargeResult, folder: Path) -> None:
    """burden.png, charge.png, curves.png and wear.png."""
    draw_wear(result, folder / "wear.png")
    draw_burden(result, folder / "burden.png")
    draw_charge(result, folder / "charge.png")
    draw_curves(result, folder / "curves.png")

"""The Pareto picture of a deflector study: evenness of mass against evenness of size, every design a ball."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from demcore.canvas import GREY, INK, Canvas, Colour
from demcore.picture import save_png
from worker.deflector.study import Tried, arrays_of, front_of
from worker.optimizer.design import FloatArray

RED: Colour = (200, 60, 50)
BLUE: Colour = (40, 110, 190)
WIDTH, HEIGHT, LEFT, TOP, SIDE = 900, 760, 110, 60, 620
DOT = 5


def draw_pareto(designs: Sequence[Tried], path: Path, present: int = 0, chosen: int | None = None) -> None:
    """Write it as PNG: the front in blue, the present device red, the chosen one ringed."""
    canvas = Canvas(WIDTH, HEIGHT)
    there = [k for k, t in enumerate(designs) if t.has_result]
    canvas.words(14, 10, f"{len(there)} deflectors, mean over the materials; lower left is more even", 16)
    if not there:
        return save_png(canvas.image, path)
    _, f = arrays_of([designs[k] for k in there])
    low, high = f.min(axis=0), f.max(axis=0)
    span = np.where(high > low, high - low, 1.0)
    low, span = low - 0.05 * span, 1.1 * span
    place = {k: _pixel((f[i] - low) / span) for i, k in enumerate(there)}
    canvas.strip([(LEFT, TOP), (LEFT, TOP + SIDE), (LEFT + SIDE, TOP + SIDE)], GREY, 1)
    canvas.words(LEFT, TOP + SIDE + 26, "mass by sector varies by (coefficient of variation)", 14)
    canvas.words(14, TOP - 24, "size by sector varies by", 14)
    for share in (0.0, 1.0):
        x, y = low + share * span
        canvas.words(LEFT + share * SIDE - 20, TOP + SIDE + 6, f"{x:.3g}", 12)
        canvas.words(LEFT - 56, TOP + (1.0 - share) * SIDE - 8, f"{y:.3g}", 12)
    front = front_of(designs)
    canvas.strip([place[k] for k in front], BLUE, 1)
    for k in there:
        x, y = place[k]
        colour = RED if k == present else BLUE if k in front else GREY
        canvas.box(x - DOT, y - DOT, 2 * DOT, 2 * DOT, colour)
        canvas.words(x + 8, y - 8, "present" if k == present else str(k), 12, colour)
    if chosen is not None and chosen in place:
        x, y = place[chosen]
        ring = [(x - 9, y - 9), (x + 9, y - 9), (x + 9, y + 9), (x - 9, y + 9), (x - 9, y - 9)]
        canvas.strip(ring, INK, 2)
    return save_png(canvas.image, path)


def _pixel(share: FloatArray) -> tuple[float, float]:
    return LEFT + float(share[0]) * SIDE, TOP + (1.0 - float(share[1])) * SIDE

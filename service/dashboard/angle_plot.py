"""A study's history as a drawing without scripts: angle against simulation, with the window and the target."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from service.dashboard.formats import round_step
from service.db.models import DesignRow

# Of the drawing, in its own units; what is left of it is the plot.
WIDTH, HEIGHT = 680.0, 260.0
LEFT, RIGHT, TOP, BOTTOM = 46.0, 10.0, 10.0, 34.0
# About so many lines with a number on each axis.
TICKS = 6


@dataclass(frozen=True)
class Point:
    """One simulation; `low` and `high`: the ends of its standard error."""

    number: int
    x: float
    y: float
    low: float
    high: float
    verdict: str
    is_chosen: bool
    told: str


@dataclass(frozen=True)
class AnglePlot:
    """Places in the drawing's units. Ticks: a place and its number."""

    points: tuple[Point, ...]
    window: tuple[float, float]
    target: float
    x_ticks: tuple[tuple[float, str], ...]
    y_ticks: tuple[tuple[float, str], ...]
    width: float = WIDTH
    height: float = HEIGHT
    left: float = LEFT
    right: float = WIDTH - RIGHT
    top: float = TOP
    bottom: float = HEIGHT - BOTTOM


def draw_angles(
    designs: Sequence[DesignRow], window: tuple[float, float], target: float, chosen: Collection[int]
) -> AnglePlot | None:
    """None where no simulation has an angle."""
    seen = [row for row in designs if row.angle_deg is not None]
    if not seen:
        return None
    values = [*window, target, *(row.angle_deg for row in seen if row.angle_deg is not None)]
    low, high = min(values), max(values)
    space = 0.06 * (high - low or 1.0)
    low, high = low - space, high + space
    last = max(row.number for row in seen)

    def across(number: float) -> float:
        return round(LEFT + (WIDTH - LEFT - RIGHT) * (number - 0.5) / last, 2)

    def up(value: float) -> float:
        share = min(max((value - low) / (high - low), 0.0), 1.0)
        return round(HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * share, 2)

    points = []
    for row in seen:
        angle, error = row.angle_deg or 0.0, row.angle_sd_deg or 0.0
        verdict = row.verdict.value if row.verdict else "error"
        told = f"simulation {row.number}: {angle:.2f}°, {verdict}"
        points.append(
            Point(
                row.number,
                across(row.number),
                up(angle),
                up(angle - error),
                up(angle + error),
                verdict,
                row.number in chosen,
                told,
            )
        )
    return AnglePlot(
        points=tuple(points),
        window=(up(window[0]), up(window[1])),
        target=up(target),
        x_ticks=tuple((across(k), f"{k:g}") for k in _round_numbers(1.0, last) if k == int(k) and k >= 1),
        y_ticks=tuple((up(v), f"{v:g}") for v in _round_numbers(low, high)),
    )


def _round_numbers(low: float, high: float) -> list[float]:
    """Multiples of 1, 2 or 5 times a power of ten between the two, about TICKS of them."""
    step = round_step(max(high - low, 1e-9) / TICKS)
    first = math.ceil(low / step - 1e-9)
    return [round(k * step, 10) for k in range(first, math.floor(high / step + 1e-9) + 1)]

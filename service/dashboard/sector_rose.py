"""The burden by circumferential sector as a rose: each wedge as long as its mass, darker with larger grains.

Notation: the drawing's plane has x to the right, the way the belt runs, and the plant's y upwards; 100 is the
longest wedge.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

LONGEST = 100.0
FAINTEST = 0.25


@dataclass(frozen=True)
class Wedge:
    """One sector: its outline, how dark it is, 0 to 1, what a reader is told of it, and its numbers."""

    path: str
    shade: float
    told: str
    azimuth_deg: float
    mass_kg: float
    size_m: float | None


@dataclass(frozen=True)
class Rose:
    """All wedges; `mean`: the radius of the mean mass; `deflector`: the end of a line towards its ridge."""

    wedges: tuple[Wedge, ...]
    mean: float
    mean_kg: float
    most_kg: float
    deflector: tuple[float, float] | None


def draw_rose(results: Mapping[str, Any]) -> Rose | None:
    """From a charge's summary; None where it has no sectors with mass."""
    sectors = results.get("sectors") or {}
    masses = sectors.get("mass") or []
    if not masses or max(masses) <= 0.0:
        return None
    half, most = math.pi / len(masses), max(masses)
    sizes = [size for size in sectors["size"] if size is not None]
    low, span = (min(sizes), (max(sizes) - min(sizes)) or 1.0) if sizes else (0.0, 1.0)
    wedges = []
    for azimuth, mass, size in zip(sectors["azimuth_deg"], masses, sectors["size"], strict=True):
        share = 0.0 if size is None else (size - low) / span
        told = f"{azimuth:.0f}°: {mass:.0f} kg" + ("" if size is None else f", {1e3 * size:.0f} mm")
        path = _wedge(math.radians(azimuth), half, LONGEST * mass / most)
        wedges.append(Wedge(path, round(FAINTEST + (1.0 - FAINTEST) * share, 3), told, azimuth, mass, size))
    mean = sum(masses) / len(masses)
    return Rose(tuple(wedges), round(LONGEST * mean / most, 2), mean, most, _deflector(results))


def _wedge(middle: float, half: float, radius: float) -> str:
    ends = [(radius * math.cos(a), -radius * math.sin(a)) for a in (middle - half, middle + half)]
    (ax, ay), (bx, by) = ends
    return f"M0 0L{ax:.2f} {ay:.2f}A{radius:.2f} {radius:.2f} 0 0 0 {bx:.2f} {by:.2f}Z"


def _deflector(results: Mapping[str, Any]) -> tuple[float, float] | None:
    device = results.get("inputs", {}).get("plant", {}).get("deflector", {})
    x, y = device.get("ridge_across"), device.get("ridge_along")
    if x is None or y is None or math.hypot(x, y) == 0.0:
        return None
    length = LONGEST / math.hypot(x, y)
    return round(x * length, 2), round(-y * length, 2)

"""What a laboratory reads off a heap: surface, angle, masses, times. Written apart from the analyser's readers.

The angle is that of physics.md, section 5: a straight line per sector through the scanned surface between .15 and
.9 of the plate's radius. Lengths m, masses kg, times s, angles degrees.
"""

from __future__ import annotations

import math

import numpy as np

from tests.diagnosis.piles.liggghts_pile import FLOOR, Array, Heap, Pile

SECTORS, RINGS = 24, 10
GRID = 0.004
INNER, OUTER = 0.15, 0.9


def surface(heap: Heap, base: float) -> tuple[Array, Array, Array]:
    """x, y and height (n,) of the scanned points over the plate."""
    n = math.ceil(base / GRID)
    axis = np.arange(-n, n + 1) * GRID
    x, y = np.meshgrid(axis, axis, indexing="ij")
    height = np.zeros_like(x)
    for (px, py, pz), r in zip(heap.position, heap.radius, strict=True):
        near = (np.abs(axis - px) < r), (np.abs(axis - py) < r)
        part = np.ix_(*near)
        rest = r**2 - (x[part] - px) ** 2 - (y[part] - py) ** 2
        height[part] = np.maximum(
            height[part], np.where(rest > 0.0, pz + np.sqrt(np.maximum(rest, 0.0)), 0.0)
        )
    return x.ravel(), y.ravel(), height.ravel()


def angle_of(x: Array, y: Array, h: Array, base: float) -> float:
    """Mean over the sectors of the fitted slope."""
    r, sector = np.hypot(x, y), np.floor(np.arctan2(y, x) % (2 * np.pi) / (2 * np.pi) * SECTORS).astype(int)
    found = []
    for k in range(SECTORS):
        here = (sector % SECTORS == k) & (r > INNER * base) & (r < OUTER * base)
        found.append(math.degrees(math.atan(-np.polyfit(r[here], h[here], 1)[0])))
    return float(np.mean(found))


def heights(x: Array, y: Array, h: Array, base: float) -> Array:
    """Mean height of each polar cell, ring after ring (RINGS * SECTORS,)."""
    r, turn = np.hypot(x, y), np.arctan2(y, x) % (2 * np.pi) / (2 * np.pi)
    on = r < base
    cell = np.minimum((r[on] / base * RINGS).astype(int), RINGS - 1) * SECTORS
    cell += np.minimum((turn[on] * SECTORS).astype(int), SECTORS - 1)
    return np.bincount(cell, h[on], SECTORS * RINGS) / np.bincount(cell, minlength=SECTORS * RINGS)


def readings(pile: Pile, heap: Heap) -> tuple[dict[str, float], Array]:
    """Observables by the names of the data format, and the heights (RINGS * SECTORS,)."""
    base = pile.base_radius
    x, y, h = surface(heap, base)
    place, radius = heap.position, heap.radius
    on = (np.hypot(place[:, 0], place[:, 1]) < base) & (place[:, 2] > 0.0)
    mass = pile.mass_per_sphere * (2.0 * radius[on]) ** 3
    order = np.argsort(radius[on])
    half = np.searchsorted(np.cumsum(mass[order]), 0.5 * mass.sum())
    filled, left = float(heap.mass[0]), heap.mass[0] - heap.mass
    # Behind a rim nothing may leave, and then no time was measured.
    t90 = float(heap.time[np.searchsorted(left, 0.9 * left[-1])]) if left[-1] > 0.0 else math.nan
    values = {
        "repose_angle_deg": angle_of(x, y, h, base),
        "apex_height_m": float(h[np.hypot(x, y) < base].max()),
        "mass_on_base_kg": float(mass.sum()),
        "discharge_t90_s": t90,
        "bulk_density_kg_m3": filled / (math.pi * pile.cylinder_radius**2 * heap.fill_height),
        "heap_offset_x_m": float(np.average(place[on, 0], weights=mass)),
        "heap_offset_y_m": float(np.average(place[on, 1], weights=mass)),
        "d50_on_base_m": 2.0 * pile.grain_per_sphere * float(radius[on][order][half]),
    }
    assert place[:, 2].min() > FLOOR
    return values, heights(x, y, h, base)

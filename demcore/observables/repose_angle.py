"""Repose angle of a pile on a round base, by surface scan and by the paper's literal four steps.

Source: physics.md section 5; the paper's section 2.1.3. R base radius, m; r distance from the axis; h height.

The scan is what a laser sees: the height field of the sphere tops on a fine grid, and a straight line through
it per sector for .15 R < r < .9 R (the apex is rounded, the toe spills over the edge). It is the angle that
Talus calibrates. The literal reading takes the highest particle *centre* in each radial bin of each sector; on
a coarse pile most bins hold one buried particle or none, and it reads up to 10 degrees low. It is reported
beside the scan, with the share of bins that hold fewer than 3 particles.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.errors import NoResult
from demcore.jit import kernel
from demcore.particles import Floats

SCAN_GRID = 0.004
SCAN_SECTORS = 24
INNER, OUTER = 0.15, 0.90
FEW = 3


class HeightField(NamedTuple):
    """height (n, n), m above the base, 0 where the base is bare; axis (n,) cell centres in x and in y, m."""

    height: Floats
    axis: Floats


class AngleReading(NamedTuple):
    """sectors (S,) degrees, nan for a sector that could not be fitted; mean and standard error, degrees;
    intercept: mean height of the fitted lines at r = 0, m."""

    sectors: Floats
    mean: float
    standard_error: float
    intercept: float


@kernel
def _raise_tops(height: Floats, axis: Floats, position: Floats, radius: Floats) -> None:
    cell = axis[1] - axis[0]
    n = len(axis)
    for k in range(len(radius)):
        x, y, z, r = position[k, 0], position[k, 1], position[k, 2], radius[k]
        for i in range(
            max(0, int((x - r - axis[0]) / cell)), min(n - 1, int((x + r - axis[0]) / cell) + 1) + 1
        ):
            for j in range(
                max(0, int((y - r - axis[0]) / cell)), min(n - 1, int((y + r - axis[0]) / cell) + 1) + 1
            ):
                rest = r * r - (axis[i] - x) ** 2 - (axis[j] - y) ** 2
                if rest > 0.0:
                    height[i, j] = max(height[i, j], z + math.sqrt(rest))


def scan_heights(
    position: Floats, radius: Floats, base_radius: float, grid: float = SCAN_GRID
) -> HeightField:
    """Height field over the square around the base; positions (N, 3) m with the base at z = 0."""
    half = int(np.ceil(base_radius / grid))
    axis: Floats = np.arange(-half, half + 1, dtype=np.float64) * grid
    height = np.zeros((len(axis), len(axis)))
    _raise_tops(height, axis, np.ascontiguousarray(position), np.ascontiguousarray(radius))
    return HeightField(height, axis)


def _fit_sectors(r: Floats, theta: Floats, h: Floats, sectors: int, few: int) -> tuple[Floats, Floats]:
    """Least-squares slope and intercept of h over r per sector; nan with fewer than `few` points."""
    index = np.minimum((theta % (2.0 * np.pi)) / (2.0 * np.pi) * sectors, sectors - 1).astype(np.int64)
    count = np.bincount(index, minlength=sectors).astype(float)
    sum_r = np.bincount(index, r, sectors)
    sum_h = np.bincount(index, h, sectors)
    spread = count * np.bincount(index, r * r, sectors) - sum_r**2
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = (count * np.bincount(index, r * h, sectors) - sum_r * sum_h) / spread
        intercept = (sum_h - slope * sum_r) / count
    missing = (count < few) | (spread <= 0.0)
    slope[missing] = np.nan
    intercept[missing] = np.nan
    return slope, intercept


def _reading(slope: Floats, intercept: Floats) -> AngleReading:
    """Raises NoResult when under half of the sectors could be fitted."""
    angles = np.degrees(np.arctan(-slope))
    good = np.isfinite(angles)
    if good.sum() * 2 < len(angles):
        raise NoResult(f"only {int(good.sum())} of {len(angles)} sectors hold a slope: no pile to measure")
    error = float(angles[good].std(ddof=1) / np.sqrt(good.sum()))
    return AngleReading(angles, float(angles[good].mean()), error, float(np.nanmean(intercept)))


def surface_scan(field: HeightField, base_radius: float, sectors: int = SCAN_SECTORS) -> AngleReading:
    """The calibrated angle. Raises NoResult on an empty base."""
    x, y = np.meshgrid(field.axis, field.axis, indexing="ij")
    r = np.hypot(x, y)
    inside = (r > INNER * base_radius) & (r < OUTER * base_radius)
    if float((field.height[inside] > 0.0).mean()) < 0.5:
        raise NoResult(
            "more than half of the base between .15 and .9 of its radius is bare: no pile to measure"
        )
    theta = np.arctan2(y[inside], x[inside])
    return _reading(*_fit_sectors(r[inside], theta, field.height[inside], sectors, 2))


def literal_reading(
    position: NDArray[np.float64], base_radius: float, circular_sectors: int, radial_sectors: int
) -> tuple[AngleReading, float]:
    """The paper's four steps with its Table 4 sectors; also the share of bins with fewer than 3 particles."""
    r = np.hypot(position[:, 0], position[:, 1])
    on = r < base_radius
    r, z, theta = r[on], position[on, 2], np.arctan2(position[on, 1], position[on, 0]) % (2.0 * np.pi)
    sector = np.minimum(theta / (2.0 * np.pi) * circular_sectors, circular_sectors - 1).astype(np.int64)
    ring = np.minimum(r / base_radius * radial_sectors, radial_sectors - 1).astype(np.int64)
    place = sector * radial_sectors + ring
    bins = circular_sectors * radial_sectors
    share_few = float((np.bincount(place, minlength=bins) < FEW).mean())
    # Ascending height, so the last write into a bin is its highest centre.
    ascending = np.argsort(z, kind="stable")
    highest = np.full(bins, -1, np.int64)
    highest[place[ascending]] = ascending
    top = highest[highest >= 0]
    return _reading(*_fit_sectors(r[top], theta[top], z[top], circular_sectors, 2)), share_few


def top_height(field: HeightField, base_radius: float) -> float:
    """Mean height, m, of the scanned surface within INNER of the base's radius: the top, where no line fits."""
    inside = np.hypot(field.axis[:, None], field.axis[None, :]) < INNER * base_radius
    return float(field.height[inside].mean())


class HeapProfile(NamedTuple):
    """Ring-wise heights, all (B,), m: radius of the ring, mean height, 5 % and 95 % quantiles around it."""

    radius: Floats
    height: Floats
    low: Floats
    high: Floats


def heap_profile(field: HeightField, base_radius: float, rings: int = 30) -> HeapProfile:
    """h(r) of the scanned surface, with the band that holds 90 % of the ring."""
    x, y = np.meshgrid(field.axis, field.axis, indexing="ij")
    r = np.hypot(x, y).ravel()
    inside = r < base_radius
    ring = np.minimum(r[inside] / base_radius * rings, rings - 1).astype(np.int64)
    heights = field.height.ravel()[inside]
    rows = [heights[ring == k] for k in range(rings)]
    middle = (np.arange(rings) + 0.5) * base_radius / rings
    return HeapProfile(
        middle,
        np.array([h.mean() for h in rows]),
        np.array([np.quantile(h, 0.05) for h in rows]),
        np.array([np.quantile(h, 0.95) for h in rows]),
    )

"""What a belt carries and throws: the section of its bed with the layers, and the jet's envelope.

Notation: across, above place in the belt's section, from its middle and from its middle plane, m; m mass, kg;
d diameter, m. Both records only add up sums, so that a run may keep them in its checkpoint.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

GRAVITY = 9.81
CELL = 0.02
# Bins of the jet, m: fine against any grain.
BIN = 0.01


class BeltSection:
    """Mass and size over the section of a bed, `half_width` m to either side and up to `height` m."""

    def __init__(self, half_width: float, height: float) -> None:
        self.half_width, self.height = half_width, height
        self.shape = (math.ceil(2.0 * half_width / CELL), math.ceil(height / CELL))
        self.mass = np.zeros(self.shape)
        self.moment = np.zeros(self.shape)
        self.sums = np.zeros(6)
        self.samples = 0

    def add(self, across: Floats, above: Floats, diameter: Floats, mass: Floats) -> None:
        """A stretch of belt more: what lay on it, (N,) each."""
        self.samples += 1
        i = np.clip(((across + self.half_width) / CELL).astype(np.int64), 0, self.shape[0] - 1)
        j = np.clip((above / CELL).astype(np.int64), 0, self.shape[1] - 1)
        np.add.at(self.mass, (i, j), mass)
        np.add.at(self.moment, (i, j), mass * diameter)
        self.sums += [
            float((mass * term).sum())
            for term in (np.ones(len(mass)), above, diameter, above * diameter, above**2, diameter**2)
        ]

    def size_by_height(self) -> tuple[Floats, Floats, Floats]:
        """Layers from the belt upwards (J,): height of the middle, m; share of the mass; mean diameter by mass, m,
        nan where there is nothing."""
        mass = self.mass.sum(axis=0)
        heights = (np.arange(self.shape[1]) + 0.5) * CELL
        with np.errstate(invalid="ignore", divide="ignore"):
            share, size = mass / mass.sum(), self.moment.sum(axis=0) / mass
        return np.asarray(heights, np.float64), np.asarray(share, np.float64), np.asarray(size, np.float64)

    def stratification(self) -> float:
        """Correlation by mass of a grain's height with its diameter: positive when large ones lie high."""
        m, h, d, hd, hh, dd = self.sums
        if m <= 0.0:
            return math.nan
        spread = (hh / m - (h / m) ** 2) * (dd / m - (d / m) ** 2)
        return float((hd / m - h * d / m**2) / math.sqrt(spread)) if spread > 0.0 else math.nan

    def mass_per_metre(self, length: float) -> float:
        """kg/m of belt, when each sample was `length` m long."""
        return float(self.sums[0]) / (self.samples * length) if self.samples else math.nan

    def numbers(self) -> dict[str, Any]:
        """State to save, JSON-able."""
        return {
            "mass": self.mass.tolist(),
            "moment": self.moment.tolist(),
            "sums": self.sums.tolist(),
            "samples": self.samples,
        }

    def restore(self, numbers: Mapping[str, Any]) -> None:
        """As `numbers` says."""
        self.mass, self.moment = np.array(numbers["mass"]), np.array(numbers["moment"])
        self.sums, self.samples = np.array(numbers["sums"]), int(numbers["samples"])


class JetEnvelope:
    """Where falling grains pass given heights: `levels` (L,) z, m, on a line from `low` to `high` x, m; or where
    they would be `ahead` m below these if nothing came in their way."""

    def __init__(self, levels: Floats, low: float, high: float, ahead: float = 0.0) -> None:
        self.levels, self.low, self.high, self.ahead = levels, low, high, ahead
        self.mass = np.zeros((len(levels), math.ceil((high - low) / BIN)))
        self.moment = np.zeros_like(self.mass)

    def add(
        self, position: Floats, velocity: Floats, diameter: Floats, mass: Floats, interval: float
    ) -> None:
        """Grains (N,) of which some passed a level in the last `interval` s, taken back along their fall."""
        for k, level in enumerate(self.levels):
            speed, below = -velocity[:, 2], level - position[:, 2]
            with np.errstate(divide="ignore", invalid="ignore"):
                # Back along the parabola: g t^2 / 2 - speed t + below = 0, its earlier root without cancellation.
                since = 2.0 * below / (speed + np.sqrt(speed**2 - 2.0 * GRAVITY * below))
            passed = (speed > 0.0) & (since >= 0.0) & (since < interval)
            then = speed[passed] - GRAVITY * since[passed]
            further = (np.sqrt(then**2 + 2.0 * GRAVITY * self.ahead) - then) / GRAVITY
            x = position[passed, 0] + velocity[passed, 0] * (further - since[passed])
            column = np.clip(((x - self.low) / BIN).astype(np.int64), 0, self.mass.shape[1] - 1)
            np.add.at(self.mass[k], column, mass[passed])
            np.add.at(self.moment[k], column, mass[passed] * diameter[passed])

    def quantiles(self, shares: tuple[float, ...] = (0.05, 0.5, 0.95)) -> Floats:
        """(L, Q) x, m, below which these shares of the mass pass each level; nan where none did."""
        found = np.full((len(self.levels), len(shares)), np.nan)
        edges = self.low + BIN * np.arange(self.mass.shape[1] + 1)
        for k, row in enumerate(self.mass):
            total = float(row.sum())
            if total > 0.0:
                found[k] = np.interp(shares, np.concatenate([[0.0], np.cumsum(row) / total]), edges)
        return found

    def split(self, level: int, x: float) -> tuple[float, float, float]:
        """At one level: share of the mass beyond x (m), and the mean diameter by mass before and beyond it, m."""
        middles = self.low + BIN * (np.arange(self.mass.shape[1]) + 0.5)
        row, moment, far = self.mass[level], self.moment[level], middles > x
        total = float(row.sum())
        if total <= 0.0:
            return math.nan, math.nan, math.nan
        sizes = [
            float(moment[side].sum() / row[side].sum()) if row[side].sum() > 0.0 else math.nan
            for side in (~far, far)
        ]
        return float(row[far].sum()) / total, sizes[0], sizes[1]

    def beyond(self, level: int) -> tuple[Floats, Floats]:
        """x (E,), m, and the share of the mass that passes one level beyond it, from the last x with all of it to
        the first with none; empty where nothing passed."""
        row = self.mass[level]
        total = float(row.sum())
        if total <= 0.0:
            return np.zeros(0), np.zeros(0)
        there = np.flatnonzero(row)
        edges = np.arange(there[0], there[-1] + 2)
        share = 1.0 - np.concatenate([[0.0], np.cumsum(row)])[edges] / total
        return self.low + BIN * edges, np.clip(share, 0.0, 1.0)

    def numbers(self) -> dict[str, Any]:
        """State to save, JSON-able."""
        return {"mass": self.mass.tolist(), "moment": self.moment.tolist()}

    def restore(self, numbers: Mapping[str, Any]) -> None:
        """As `numbers` says."""
        self.mass, self.moment = np.array(numbers["mass"]), np.array(numbers["moment"])

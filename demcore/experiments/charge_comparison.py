"""Charges beside each other: two materials, two scales, seeds, sets of contact numbers, or a charge and its plant.

All of it works on summaries (ChargeResult.summary with its findings, or one read from a file), by groups: what
two groups differ by stands beside the scatter inside them. Importable without numba.

Notation: m mean, s standard deviation, n charges of a group; the noise of a difference of means is
sqrt(s1^2 / n1 + s2^2 / n2) (Welch 1947), nan where a group has one charge.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from demcore.errors import InputError

# A difference counts when it is so many times its noise.
BEYOND = 2.0
# Number, unit, and where it stands in a summary.
NUMBERS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "piles": ("1", ("findings", "piles")),
    "far_height_m": ("m", ("findings", "far_height_m")),
    "near_height_m": ("m", ("findings", "near_height_m")),
    "far_size_m": ("m", ("findings", "far_size_m")),
    "near_size_m": ("m", ("findings", "near_size_m")),
    "far_mass_kg": ("kg", ("findings", "far_mass_kg")),
    "near_mass_kg": ("kg", ("findings", "near_mass_kg")),
    "far_slope_deg": ("deg", ("findings", "far_slope_deg")),
    "near_slope_deg": ("deg", ("findings", "near_slope_deg")),
    "far_share_of_mass": ("1", ("far_share_of_mass",)),
    "far_of_ridge": ("1", ("jet", "far_of_ridge")),
    "variation_of_mass": ("1", ("variation_of_mass",)),
    "variation_of_height": ("1", ("variation_of_height",)),
    "variation_of_size": ("1", ("variation_of_size",)),
    "segregation_intensity": ("1", ("segregation_intensity",)),
    "stratification": ("1", ("belt", "stratification")),
    "belt_rate_kg_s": ("kg/s", ("belt", "rate_kg_s")),
    "bulk_density_kg_m3": ("kg/m3", ("bulk_density_kg_m3",)),
    "level_if_even_m": ("m", ("level_if_even_m",)),
    "mean_diameter_m": ("m", ("mean_diameter_m",)),
    "lost_kg": ("kg", ("lost_kg",)),
}
AZIMUTH, HEIGHT = "azimuth_deg", "height_m"


class Group(NamedTuple):
    """A number over the charges of a group: mean, standard deviation (nan for one), how many charges have it."""

    mean: float
    sd: float
    charges: int


class Row(NamedTuple):
    """A number by group; of two groups the difference, its noise, and whether it stands out (None: unknown)."""

    name: str
    unit: str
    groups: dict[str, Group]
    difference: float
    noise: float
    stands_out: bool | None


def number_of(summary: Mapping[str, Any], name: str) -> float:
    """One of NUMBERS; nan where the summary has none."""
    value: Any = summary
    for key in NUMBERS[name][1]:
        value = value.get(key) if isinstance(value, Mapping) else None
    return math.nan if value is None else float(value)


def group_of(values: Sequence[float]) -> Group:
    """Mean and scatter of what is there."""
    there = np.array([v for v in values if math.isfinite(v)])
    if not len(there):
        return Group(math.nan, math.nan, 0)
    sd = float(there.std(ddof=1)) if len(there) > 1 else math.nan
    return Group(float(there.mean()), sd, len(there))


def compare(groups: Mapping[str, Sequence[Mapping[str, Any]]]) -> list[Row]:
    """Every number by group. Raises InputError for no group, and for one without charges."""
    if not groups or not all(groups.values()):
        raise InputError(
            "groups", {name: len(of) for name, of in groups.items()}, "groups of one charge or more"
        )
    rows = []
    for name, (unit, _) in NUMBERS.items():
        found = {label: group_of([number_of(s, name) for s in of]) for label, of in groups.items()}
        rows.append(Row(name, unit, found, *_difference(list(found.values()))))
    return rows


def _difference(groups: list[Group]) -> tuple[float, float, bool | None]:
    if len(groups) != 2:
        return math.nan, math.nan, None
    a, b = groups
    difference = b.mean - a.mean
    if a.charges < 2 or b.charges < 2:
        return difference, math.nan, None
    noise = math.sqrt(a.sd**2 / a.charges + b.sd**2 / b.charges)
    return difference, noise, abs(difference) > BEYOND * noise


class PlantHeights(NamedTuple):
    """Heights of a burden above the bell's seat as somebody measured them: azimuth, degrees, and height, m."""

    azimuth_deg: tuple[float, ...]
    height_m: tuple[float, ...]


class Agreement(NamedTuple):
    """A charge against measured heights: what it reads at their azimuths (m), its bias and rms difference (m), and
    the correlation of the two profiles (nan for fewer than three places, or a level one)."""

    here_m: tuple[float, ...]
    bias_m: float
    rms_m: float
    correlation: float


def read_heights(text: str) -> PlantHeights:
    """A CSV with the columns azimuth_deg and height_m. Raises InputError with line and column."""
    reader = csv.DictReader(io.StringIO(text))
    columns = reader.fieldnames or []
    for name in (AZIMUTH, HEIGHT):
        if name not in columns:
            raise InputError(
                "plant_heights", ", ".join(columns) or "nothing", f"columns {AZIMUTH} and {HEIGHT}"
            )
    rows = [(_cell(reader.line_num, AZIMUTH, row), _cell(reader.line_num, HEIGHT, row)) for row in reader]
    if not rows:
        raise InputError("plant_heights", "no rows", "at least one row")
    azimuth, height = zip(*rows, strict=True)
    return PlantHeights(tuple(a % 360.0 for a in azimuth), height)


def _cell(line: int, name: str, row: Mapping[str, str | None]) -> float:
    try:
        value = float(row[name] or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"plant_heights, line {line}, {name}", row[name], "a finite number")
    return value


def against_plant(summary: Mapping[str, Any], measured: PlantHeights) -> Agreement:
    """The charge's mean heights by sector, read between the sectors' middles, beside the measured ones."""
    sectors = summary["sectors"]
    seat = -float(summary["inputs"]["plant"]["hopper"]["seat_depth"])
    heights = np.array(sectors["height"], float) - seat
    here = np.interp(measured.azimuth_deg, np.array(sectors["azimuth_deg"], float), heights, period=360.0)
    gap = here - np.array(measured.height_m)
    flat = len(here) < 3 or np.ptp(here) == 0.0 or np.ptp(measured.height_m) == 0.0
    correlation = math.nan if flat else float(np.corrcoef(here, measured.height_m)[0, 1])
    return Agreement(tuple(here.tolist()), float(gap.mean()), float(np.sqrt((gap**2).mean())), correlation)

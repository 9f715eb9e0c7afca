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
from numpy.typing import NDArray

from demcore.errors import InputError

FloatArray = NDArray[np.float64]

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
    "far_side_size_m": ("m", ("far_side_size_m",)),
    "near_side_size_m": ("m", ("near_side_size_m",)),
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
AZIMUTH, HEIGHT, PRESSURE = "azimuth_deg", "height_m", "pressure_kpa"
# With fewer taps hardly a turning is left to compare with.
FEWEST_TAPS = 4


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


class PlantProfile(NamedTuple):
    """What somebody measured around the hopper: azimuth, degrees, and a height above the bell's seat, m, or the
    pressure of a tap below, kPa."""

    azimuth_deg: tuple[float, ...]
    value: tuple[float, ...]


class Agreement(NamedTuple):
    """A charge against measured heights: what it reads at their azimuths (m), its bias and rms difference (m), and
    the correlation of the two profiles (nan for fewer than three places, or a level one)."""

    here_m: tuple[float, ...]
    bias_m: float
    rms_m: float
    correlation: float


class PressureAgreement(NamedTuple):
    """A charge against pressure taps, which tell where the layer is thick and not how thick: its heights at the
    taps (m), the rank correlation with the pressures (nan where either is level), and the share of the profile's
    turnings about the axis by whole taps that correlate at least as strongly, itself among them."""

    here_m: tuple[float, ...]
    rank_correlation: float
    as_strong_when_turned: float


def read_heights(text: str) -> PlantProfile:
    """A CSV with the columns azimuth_deg and height_m. Raises InputError with line and column."""
    return _read_profile("plant_heights", HEIGHT, text, fewest=1)


def read_pressures(text: str) -> PlantProfile:
    """A CSV with the columns azimuth_deg and pressure_kpa, four taps at least. Raises InputError."""
    return _read_profile("plant_pressures", PRESSURE, text, fewest=FEWEST_TAPS)


def _read_profile(field: str, column: str, text: str, fewest: int) -> PlantProfile:
    reader = csv.DictReader(io.StringIO(text))
    columns = reader.fieldnames or []
    for name in (AZIMUTH, column):
        if name not in columns:
            raise InputError(field, ", ".join(columns) or "nothing", f"columns {AZIMUTH} and {column}")
    rows = [
        (_cell(field, reader.line_num, AZIMUTH, row), _cell(field, reader.line_num, column, row))
        for row in reader
    ]
    if len(rows) < fewest:
        found = f"{len(rows)} rows" if rows else "no rows"
        raise InputError(field, found, "at least one row" if fewest == 1 else f"at least {fewest} rows")
    azimuth, value = zip(*rows, strict=True)
    return PlantProfile(tuple(a % 360.0 for a in azimuth), value)


def _cell(field: str, line: int, name: str, row: Mapping[str, str | None]) -> float:
    try:
        value = float(row[name] or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{field}, line {line}, {name}", row[name], "a finite number")
    return value


def against_plant(summary: Mapping[str, Any], measured: PlantProfile) -> Agreement:
    """The charge's mean heights by sector, read between the sectors' middles, beside the measured ones."""
    here = _heights_at(summary, measured.azimuth_deg)
    gap = here - np.array(measured.value)
    flat = len(here) < 3 or np.ptp(here) == 0.0 or np.ptp(measured.value) == 0.0
    correlation = math.nan if flat else float(np.corrcoef(here, measured.value)[0, 1])
    return Agreement(tuple(here.tolist()), float(gap.mean()), float(np.sqrt((gap**2).mean())), correlation)


def against_pressures(summary: Mapping[str, Any], measured: PlantProfile) -> PressureAgreement:
    """The charge's heights beside the pressures by rank (Spearman 1904): how pressure follows height is not known,
    only that it follows. Which sign is right depends on the material, so both count as strong.

    Neighbouring taps are alike, so the usual significance of n independent pairs does not hold. Turning the
    profile about the axis keeps that likeness: where many turnings agree as well, the place is not told.
    """
    order = np.argsort(measured.azimuth_deg, kind="stable")
    azimuth, pressure = np.array(measured.azimuth_deg)[order], np.array(measured.value)[order]
    here = _heights_at(summary, tuple(azimuth.tolist()))
    by_tap = np.empty(len(here))
    by_tap[order] = here
    if np.ptp(here) == 0.0 or np.ptp(pressure) == 0.0:
        return PressureAgreement(tuple(by_tap.tolist()), math.nan, math.nan)
    ranks = _ranks(pressure)
    turned = np.array([np.corrcoef(np.roll(_ranks(here), k), ranks)[0, 1] for k in range(len(here))])
    as_strong = float(np.mean(np.abs(turned) >= abs(turned[0]) - 1e-12))
    return PressureAgreement(tuple(by_tap.tolist()), float(turned[0]), as_strong)


def _heights_at(summary: Mapping[str, Any], azimuth_deg: Sequence[float]) -> FloatArray:
    """Mean heights by sector above the bell's seat (m), read between the sectors' middles."""
    sectors = summary["sectors"]
    seat = -float(summary["inputs"]["plant"]["hopper"]["seat_depth"])
    heights = np.array(sectors["height"], float) - seat
    return np.interp(azimuth_deg, np.array(sectors["azimuth_deg"], float), heights, period=360.0)


def _ranks(values: FloatArray) -> FloatArray:
    """From 1; equal values share the mean of theirs."""
    _, which, count = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(count)
    return np.asarray((last - 0.5 * (count - 1))[which], float)

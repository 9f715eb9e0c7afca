"""Summaries instead of bins: the few numbers of a pile or charge in which misfit is looked for (rule 1).

Notation (n runs, p points of a surface, s of the 24 sectors)
    ln      positive quantities enter as logarithms: their scatter is then alike over conditions, and effects add
    c_k, s_k  coefficients of cos k theta, sin k theta of a least-squares fit with harmonics 0, 1, 2
    slope   of a straight line through the heights over the radius on the middle of the flank, as an angle, deg
    toe     radius where that line meets the base; curvature: how far the flank's middle lies above its chord, m
    dipole  first harmonic of the height, all radii together, m; only what the azimuths of the points tell: a line
            through the axis from 0 to 180 degrees has no sine, lines to one side have neither

A number that cannot be had (missing cells, a surface too short) is NaN, which is normal.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np

from service.domain.data_set.columns import SECTOR_HEIGHTS, SECTOR_MASSES, SURFACES
from worker.diagnosis.simulator import FloatArray, Outcomes, Surfaces

LEAST_SECTORS = 16
_FLANK = (0.2, 0.8)
_LEAST_POINTS = 8
# Below it a cosine or a sine is that of points on the other axis, one degree off.
_LEAST_TURN = 0.02
# Standard error of a dipole over that of as many points all around. Lines at 0, 90 and 180 degrees have 1.5; at
# 0, 60 and 120 degrees the sine has 2.6, and a heap that is a little oval would read as tilted.
_LARGEST_ERROR = 2.5

# By summary: the observable that it is the logarithm of, or is itself.
LOGARITHM_OF = {
    "pile": {
        "ln_apex": "apex_height_m",
        "ln_mass": "mass_on_base_kg",
        "ln_t90": "discharge_t90_s",
        "ln_density": "bulk_density_kg_m3",
        "ln_d50": "d50_on_base_m",
    },
    "charge": {
        "ln_d50_far": "d50_far_m",
        "ln_d50_near": "d50_near_m",
        "ln_belt_depth": "belt_depth_m",
        "ln_t25": "discharge_t25_s",
        "ln_t50": "discharge_t50_s",
        "ln_t100": "discharge_t100_s",
    },
}
PLAIN_OF = {
    "pile": {"angle": "repose_angle_deg", "offset_x": "heap_offset_x_m", "offset_y": "heap_offset_y_m"},
    "charge": {"far_height": "far_pile_height_m", "near_height": "near_pile_height_m"},
}
_OF_SURFACE = ("slope", "toe", "curvature", "dipole_c", "dipole_s")
_OF_HEIGHTS = ("h_mean", "h_c1", "h_s1", "h_c2", "h_s2", "void_depth")
_OF_MASSES = ("ln_m_mean", "m_c1", "m_s1", "m_c2", "m_s2")
NAMES: Mapping[str, tuple[str, ...]] = {
    "pile": (*PLAIN_OF["pile"], *LOGARITHM_OF["pile"], *_OF_SURFACE),
    "charge": (*_OF_HEIGHTS, *PLAIN_OF["charge"], *_OF_MASSES, *LOGARITHM_OF["charge"]),
}


def of_observables(observables: Iterable[str]) -> frozenset[str]:
    """The summaries that can be had when only these observables are read."""
    read = set(observables)
    sources = {**PLAIN_OF["pile"], **PLAIN_OF["charge"], **LOGARITHM_OF["pile"], **LOGARITHM_OF["charge"]}
    found = {name for name, observable in sources.items() if observable in read}
    if SURFACES in read:
        found.update(_OF_SURFACE)
    for summaries, sectors in ((_OF_HEIGHTS, SECTOR_HEIGHTS), (_OF_MASSES, SECTOR_MASSES)):
        if len(read.intersection(sectors)) >= LEAST_SECTORS:
            found.update(summaries)
    return frozenset(found)


def summarise(test: str, outcomes: Outcomes) -> FloatArray:
    """Summaries (n, m) of n runs in the order of NAMES[test]."""
    values = outcomes.values
    found = {name: values[source] for name, source in PLAIN_OF[test].items() if source in values}
    with np.errstate(divide="ignore", invalid="ignore"):
        for name, source in LOGARITHM_OF[test].items():
            if source in values:
                found[name] = np.log(values[source])
    if test == "charge":
        found |= _sectors(values)
    elif outcomes.surfaces is not None:
        found |= of_surface(outcomes.surfaces)
    n = len(next(iter(values.values()))) if values else 0
    n = n or (0 if outcomes.surfaces is None else len(outcomes.surfaces.h_m))
    columns = [found.get(name, np.full(n, np.nan)) for name in NAMES[test]]
    table = np.column_stack(columns)
    return np.where(np.isfinite(table), table, np.nan)


def _sectors(values: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    found: dict[str, FloatArray] = {}
    heights = _table(values, SECTOR_HEIGHTS)
    if heights is not None:
        harmonics = _harmonics(heights)
        found |= dict(zip(_OF_HEIGHTS, harmonics.T, strict=False))
        found["void_depth"] = harmonics[:, 0] - _lowest(heights)
    masses = _table(values, SECTOR_MASSES)
    if masses is not None:
        harmonics = _harmonics(masses)
        with np.errstate(divide="ignore", invalid="ignore"):
            found["ln_m_mean"] = np.log(harmonics[:, 0])
            found |= dict(zip(_OF_MASSES[1:], (harmonics[:, 1:] / harmonics[:, :1]).T, strict=True))
    return found


def _table(values: Mapping[str, FloatArray], names: tuple[str, ...]) -> FloatArray | None:
    """Sectors (n, 24), NaN where missing; None where none was observed."""
    present = [values[name] for name in names if name in values]
    if not present:
        return None
    missing = np.full(len(present[0]), np.nan)
    return np.column_stack([values.get(name, missing) for name in names])


def _harmonics(sectors: FloatArray) -> FloatArray:
    """Coefficients 1, c1, s1, c2, s2 (n, 5); NaN where fewer than LEAST_SECTORS were observed."""
    angle = 2.0 * np.pi * np.arange(sectors.shape[1]) / sectors.shape[1]
    basis = np.column_stack([np.ones_like(angle), *(f(k * angle) for k in (1, 2) for f in (np.cos, np.sin))])
    found = np.full((len(sectors), 5), np.nan)
    seen = np.isfinite(sectors)
    for mask in np.unique(seen, axis=0):
        if mask.sum() >= LEAST_SECTORS:
            rows = np.all(seen == mask, axis=1)
            found[rows] = sectors[np.ix_(rows, mask)] @ np.linalg.pinv(basis[mask]).T
    return found


def _lowest(heights: FloatArray) -> FloatArray:
    """The lowest mean of five neighbouring sectors (n,)."""
    ring = np.stack([np.roll(heights, k, axis=1) for k in range(-2, 3)])
    return np.asarray(np.min(np.mean(ring, axis=0), axis=1))


def of_surface(surfaces: Surfaces) -> dict[str, FloatArray]:
    """Slope, toe, curvature and dipole of scanned surfaces, each (n,)."""
    r, h = surfaces.r_m, surfaces.h_m
    angle = np.radians(surfaces.theta_deg)
    found = {name: np.full(len(h), np.nan) for name in _OF_SURFACE}
    for k, heights in enumerate(h):
        seen = np.isfinite(heights)
        if seen.sum() < _LEAST_POINTS:
            continue
        top = np.quantile(heights[seen], 0.98)
        flank = seen & (heights > _FLANK[0] * top) & (heights < _FLANK[1] * top)
        if flank.sum() < _LEAST_POINTS // 2 or np.ptp(r[flank]) <= 0.0:
            continue
        middle = np.mean(r[flank])
        square, fall, level = np.polyfit(r[flank] - middle, heights[flank], 2)
        if fall >= 0.0:
            continue
        found["slope"][k] = np.degrees(np.arctan(-fall))
        found["toe"][k] = middle - level / fall
        found["curvature"][k] = -square * (0.5 * np.ptp(r[flank])) ** 2
        found["dipole_c"][k], found["dipole_s"][k] = _dipole(angle[seen], r[seen], heights[seen])
    return found


def _dipole(angle: FloatArray, r: FloatArray, heights: FloatArray) -> tuple[float, float]:
    """Coefficients of cosine and sine, m, from points (p,); NaN for what their azimuths do not tell.

    Where columns of the fit hang together, the answer of least norm has a share of the height in the dipole.
    """
    ring = np.column_stack([np.ones(len(r)), np.cos(angle), np.sin(angle), r])
    turns = [k for k in (1, 2) if np.max(np.abs(ring[:, k])) > _LEAST_TURN]
    basis = ring[:, [0, *turns, 3]]
    values, vectors = np.linalg.eigh(basis.T @ basis)
    variance = np.sum(vectors**2 / np.maximum(values, 1e-12), axis=1)
    wave = np.linalg.lstsq(basis, heights, rcond=None)[0]
    told = [math.nan, math.nan]
    for column, k in enumerate(turns, start=1):
        if math.sqrt(0.5 * len(r) * variance[column]) <= _LARGEST_ERROR:
            told[k - 1] = float(wave[column])
    return told[0], told[1]

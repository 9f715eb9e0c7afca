"""Where a burden lies in a round hopper: by circumferential sector, as piles and depressions, by size.

Notation: theta azimuth about the hopper's axis, counter-clockwise from x seen from above; S sectors, sector k from
2 pi k / S on; m mass, kg; d diameter, m. All functions read plain arrays: position (N, 3) m, radius (N,) m, mass
(N,) kg. Heights are z, m, of the surface of sphere tops as a laser sees it (repose_angle.py).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.observables.repose_angle import scan_heights

Floats = NDArray[np.float64]

SECTORS = 24
RINGS = 8
GRID = 0.02


class Bowl(NamedTuple):
    """The hopper's inside, a body of revolution: radius (K,) and z (K,), m, of its floor from the rod on."""

    radius: Floats
    z: Floats

    def floor(self, radius: Floats) -> Floats:
        """z of the floor at these distances from the axis, m."""
        return np.interp(radius, self.radius, self.z)

    @property
    def bottom(self) -> float:
        """Lowest z of the floor, m."""
        return float(self.z.min())


class Surface(NamedTuple):
    """The burden's surface on a grid, cells inside the bowl only: x, y, top, floor (C,), m; area of a cell, m2."""

    x: Floats
    y: Floats
    top: Floats
    floor: Floats
    cell: float

    @property
    def thickness(self) -> Floats:
        """(C,) m."""
        return self.top - self.floor


class Sectors(NamedTuple):
    """Per sector (S,): azimuth of its middle, degrees; mass, kg; particles; height, mean z of the surface, m;
    volume under the surface, m3; size, mean diameter by mass, m (nan where nothing lies)."""

    azimuth_deg: Floats
    mass: Floats
    particles: NDArray[np.int64]
    height: Floats
    volume: Floats
    size: Floats


class Harmonic(NamedTuple):
    """amplitude over the mean, and the azimuth of its maximum, degrees (of the first one counter-clockwise)."""

    amplitude: float
    azimuth_deg: float


class Pile(NamedTuple):
    """A heap along the circumference: azimuth (degrees) and radius (m) of its summit, height (z, m) there, volume
    (m3) and mass (kg) from valley to valley, its mean diameter by mass (m), and how far it stands out (m)."""

    azimuth_deg: float
    radius: float
    height: float
    volume: float
    mass: float
    size: float
    prominence: float


class Depression(NamedTuple):
    """A valley along the circumference: its azimuth, degrees, height z and depth below the heaps beside it, m, and
    the cause: the shadow that it lies in."""

    azimuth_deg: float
    height: float
    depth: float
    cause: str


class Shadow(NamedTuple):
    """What may keep material from an arc: its name, the arc's middle and half its width, degrees."""

    cause: str
    azimuth_deg: float
    half_width_deg: float


def sector_of(x: Floats, y: Floats, sectors: int) -> NDArray[np.int64]:
    """The sector of each point (N,)."""
    theta = np.arctan2(y, x) % (2.0 * np.pi)
    return np.minimum(theta / (2.0 * np.pi) * sectors, sectors - 1).astype(np.int64)


def sector_middles(sectors: int) -> Floats:
    """Azimuths of the sectors' middles, degrees."""
    return (np.arange(sectors) + 0.5) * 360.0 / sectors


def scan_surface(position: Floats, radius: Floats, bowl: Bowl, grid: float = GRID) -> Surface:
    """The burden's surface; where nothing lies it is the floor."""
    lift = np.array([0.0, 0.0, bowl.bottom])
    field = scan_heights(position - lift, radius, float(bowl.radius[-1]), grid)
    x, y = np.meshgrid(field.axis, field.axis, indexing="ij")
    r = np.hypot(x, y)
    inside = (r >= bowl.radius[0]) & (r <= bowl.radius[-1])
    floor = bowl.floor(r[inside])
    top = np.maximum(field.height[inside] + bowl.bottom, floor)
    return Surface(x[inside], y[inside], top, floor, grid * grid)


def measure_sectors(
    position: Floats, radius: Floats, mass: Floats, surface: Surface, sectors: int = SECTORS
) -> Sectors:
    """The burden by circumferential sector."""
    of = sector_of(position[:, 0], position[:, 1], sectors)
    cell = sector_of(surface.x, surface.y, sectors)
    cells = np.maximum(np.bincount(cell, minlength=sectors), 1)
    return Sectors(
        sector_middles(sectors),
        sums(of, mass, sectors),
        np.bincount(of, minlength=sectors),
        sums(cell, surface.top, sectors) / cells,
        sums(cell, surface.thickness, sectors) * surface.cell,
        mean_size(of, radius, mass, sectors),
    )


def sums(of: NDArray[np.int64], values: Floats, groups: int) -> Floats:
    """Sum of the values (N,) of each group (groups,)."""
    return np.bincount(of, values, groups).astype(np.float64)


def mean_size(of: NDArray[np.int64], radius: Floats, mass: Floats, groups: int) -> Floats:
    """Mean diameter by mass of each group (groups,), m; nan for an empty one."""
    with np.errstate(invalid="ignore"):
        return sums(of, 2.0 * radius * mass, groups) / sums(of, mass, groups)


def variation(values: Floats) -> float:
    """Coefficient of variation: standard deviation over the mean, of all values there are; 0 for even ones.

    A sector without burden has no grain size: NaN, and left out. NaN where no value is there or their mean is 0.
    """
    there = values[np.isfinite(values)]
    mean = float(there.mean()) if len(there) else 0.0
    return float(there.std()) / mean if mean else math.nan


def harmonic(values: Floats, order: int) -> Harmonic:
    """The `order`-th Fourier component along the circumference of one value a sector."""
    theta = np.radians(sector_middles(len(values)))
    component = complex((values * np.exp(-1j * order * theta)).sum()) * 2.0 / len(values)
    mean = float(values.mean())
    azimuth = math.degrees(-math.atan2(component.imag, component.real) / order) % (360.0 / order)
    return Harmonic(abs(component) / abs(mean) if mean else math.nan, azimuth)


def segregation(of: NDArray[np.int64], radius: Floats, mass: Floats, groups: int) -> tuple[float, float]:
    """Intensity of segregation by size (Danckwerts 1952), and what a random mix of so many grains would show.

    The variance by mass of the groups' mean diameters over that of the diameters: 0 when every group holds the
    same sizes, 1 when each holds a size of its own. A random mix shows sum over groups and grains of
    (m_i / M)(m_i / M_g)(d_i - d)^2 over the variance, about groups over grains. nan for grains of one size.
    """
    d, total = 2.0 * radius, float(mass.sum())
    mean = float((mass * d).sum()) / total
    spread = float((mass * (d - mean) ** 2).sum()) / total
    if spread <= 1e-18 * mean * mean:
        return math.nan, math.nan
    weight = np.bincount(of, mass, groups)
    there = weight > 0.0
    sizes = mean_size(of, radius, mass, groups)[there]
    between = float((weight[there] * (sizes - mean) ** 2).sum()) / total
    chance = float((mass * mass / weight[of] * (d - mean) ** 2).sum()) / total
    return between / spread, chance / spread


class Peak(NamedTuple):
    """A maximum of a closed profile: where, how high above the saddle that joins it to a higher one, and the
    lowest places between it and its neighbours on either side."""

    place: int
    prominence: float
    before: int
    after: int


def find_peaks(profile: Floats, least: float) -> list[Peak]:
    """Maxima of a profile around a circle whose prominence is at least `least`, in order of place.

    Prominence by persistence: from the top down, each value joins its neighbours' heaps; where two meet, the lower
    one ends. The highest of all counts down to the lowest value.
    """
    n = len(profile)
    heap = np.full(n, -1, np.int64)
    ended: dict[int, float] = {}
    for k in (int(i) for i in np.argsort(-profile, kind="stable")):
        beside = {int(heap[j]) for j in ((k - 1) % n, (k + 1) % n) if heap[j] >= 0}
        if not beside:
            heap[k] = k
            continue
        highest = max(beside, key=lambda top: (profile[top], -top))
        heap[k] = highest
        for lower in beside - {highest}:
            ended[lower] = float(profile[lower] - profile[k])
            heap[heap == lower] = highest
    top = int(heap[int(np.argmax(profile))])
    ended[top] = float(profile.max() - profile.min())
    kept = sorted(index for index, prominence in ended.items() if prominence >= least and prominence > 0.0)
    valleys = [_lowest(profile, a, b) for a, b in zip(kept, kept[1:] + kept[:1], strict=True)]
    return [Peak(k, ended[k], valleys[i - 1], valleys[i]) for i, k in enumerate(kept)]


def _lowest(profile: Floats, begin: int, end: int) -> int:
    """Place of the lowest value from `begin` on around to `end`."""
    n = len(profile)
    way = (begin + np.arange(1, (end - begin - 1) % n + 2)) % n
    return int(way[np.argmin(profile[way])])


def find_piles(
    position: Floats, radius: Floats, mass: Floats, surface: Surface, least: float, sectors: int = SECTORS
) -> list[Pile]:
    """Heaps whose mean height by sector stands out by `least`, m, or more; in order of azimuth."""
    table = measure_sectors(position, radius, mass, surface, sectors)
    cell = sector_of(surface.x, surface.y, sectors)
    of = sector_of(position[:, 0], position[:, 1], sectors)
    piles = []
    for peak in find_peaks(table.height, least):
        share = _arc(peak, sectors)
        azimuth, distance, height = _summit(surface, cell, share > 0.0)
        weight = mass * share[of]
        there = float(weight.sum())
        size = float((weight * 2.0 * radius).sum()) / there if there else math.nan
        volume = float((table.volume * share).sum())
        piles.append(Pile(azimuth, distance, height, volume, there, size, peak.prominence))
    return piles


def _arc(peak: Peak, sectors: int) -> Floats:
    """Share (S,) of each sector that belongs to a peak: 1 between its valleys, half of a valley's own."""
    share = np.zeros(sectors)
    for end, step in ((peak.before, -1), (peak.after, 1)):
        k = peak.place
        while k != end:
            share[k] = 1.0
            k = (k + step) % sectors
        share[end] += 0.5
    return np.minimum(share, 1.0)


def _summit(
    surface: Surface, cell: NDArray[np.int64], chosen: NDArray[np.bool_]
) -> tuple[float, float, float]:
    """Azimuth, degrees, radius and height, m, of the highest of RINGS patches of each chosen sector."""
    sectors = len(chosen)
    r = np.hypot(surface.x, surface.y)
    low, high = float(r.min()), float(r.max())
    ring = np.minimum((r - low) / (high - low) * RINGS, RINGS - 1).astype(np.int64)
    patch = cell * RINGS + ring
    count = np.bincount(patch, minlength=sectors * RINGS)
    top = np.bincount(patch, surface.top, sectors * RINGS) / np.maximum(count, 1)
    top[(count == 0) | ~np.repeat(chosen, RINGS)] = -np.inf
    best = int(np.argmax(top))
    middle = low + (best % RINGS + 0.5) * (high - low) / RINGS
    return float(sector_middles(sectors)[best // RINGS]), middle, float(top[best])


def find_depressions(
    heights: Floats, least: float, shadows: Sequence[Shadow], otherwise: str = "between the piles"
) -> list[Depression]:
    """Valleys between the peaks of one height a sector, with the first shadow that each lies in."""
    middles = sector_middles(len(heights))
    found = []
    peaks = find_peaks(heights, least)
    for k, peak in enumerate(peaks):
        following = peaks[(k + 1) % len(peaks)]
        beside = 0.5 * float(heights[peak.place] + heights[following.place])
        azimuth, height = float(middles[peak.after]), float(heights[peak.after])
        found.append(Depression(azimuth, height, beside - height, cause_of(azimuth, shadows, otherwise)))
    return found


def cause_of(azimuth_deg: float, shadows: Sequence[Shadow], otherwise: str) -> str:
    """The first shadow whose arc holds the azimuth."""
    for shadow in shadows:
        away = (azimuth_deg - shadow.azimuth_deg + 180.0) % 360.0 - 180.0
        if abs(away) <= shadow.half_width_deg:
            return shadow.cause
    return otherwise


def is_far(position: Floats, meridian_deg: float) -> NDArray[np.bool_]:
    """Which of the places (N, 3 or 2) lie on the far side (+x) of the upright plane through axis and azimuth."""
    alpha = math.radians(meridian_deg)
    # What is left of x across the plane.
    normal = np.array([math.sin(alpha) ** 2, -math.sin(alpha) * math.cos(alpha)])
    return np.asarray(position[:, :2] @ normal > 0.0)


def far_share(position: Floats, mass: Floats, meridian_deg: float) -> float:
    """Share of the mass on that side."""
    return float(mass[is_far(position, meridian_deg)].sum() / mass.sum())


def side_sizes(position: Floats, radius: Floats, mass: Floats, meridian_deg: float) -> tuple[float, float]:
    """Mean diameter by mass, m, of the near and of the far side, whether they are heaps or not; nan for none."""
    near, far = mean_size(is_far(position, meridian_deg).astype(np.int64), radius, mass, 2).tolist()
    return near, far


def bell_layer(
    position: Floats, radius: Floats, mass: Floats, seat: tuple[float, float], thickness: float, sectors: int
) -> tuple[Floats, Floats]:
    """What leaves first when the bell opens: mass (S,), kg, and mean diameter (S,), m, by sector of the grains
    whose centres lie within `thickness` (m) of the seat's circle, `seat` being its radius and z, m."""
    away = np.hypot(np.hypot(position[:, 0], position[:, 1]) - seat[0], position[:, 2] - seat[1])
    near = away <= thickness
    of = sector_of(position[near, 0], position[near, 1], sectors)
    return sums(of, mass[near], sectors), mean_size(of, radius[near], mass[near], sectors)

"""Which particles make up a mass: sizes and materials by mass share, the total right to one particle.

Notation: m mass of a particle, kg; M_k mass of the first k particles. Particle k belongs to a target mass while
M_k + m/2 <= target, so the total misses its target by at most half a particle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.interaction import GrainRow
from demcore.material import Material, MixPart, SizeDistribution, side_by_side

SPHERE = 4.0 / 3.0 * math.pi


class Draw(NamedTuple):
    """Particles in an order that keeps the mix's shares all along: radius (N,) m, mass (N,) kg, density (N,)
    kg/m3, row (N,) of the material tables."""

    radius: NDArray[np.float64]
    mass: NDArray[np.float64]
    density: NDArray[np.float64]
    row: NDArray[np.int32]


class Component(NamedTuple):
    """A part of a mix that differs in size, density or row; `mass_share` of the whole mix."""

    row: int
    mass_share: float
    sizes: SizeDistribution
    density: float


def components(
    mix: Sequence[MixPart], grains: Sequence[Material], rows: Sequence[GrainRow]
) -> tuple[Component, ...]:
    """The parts of a mix, split further by restitution at walls."""
    of = {g.name: g for g in grains}
    return tuple(
        Component(
            row.row,
            part.mass_share * row.wall.mass_share,
            of[part.material].sizes,
            of[part.material].particle_density,
        )
        for part in mix
        for row in rows
        if row.grain == part.material
    )


def bulk_density(mix: Sequence[MixPart], grains: Sequence[Material]) -> float:
    """kg/m3 of a mix whose parts lie side by side: 1 / sum (mass share / bulk density)."""
    of = {g.name: g.bulk_density for g in grains}
    return side_by_side([part.mass_share for part in mix], [of[part.material] for part in mix])


def draw_mass(parts: Sequence[Component], mass: float, rng: np.random.Generator) -> Draw:
    """Particles of `mass` (kg), each part by its share; at least one particle.

    A part's miss is handed to the next larger one, so the total is right to half a particle of the largest part.
    """
    drawn: list[tuple[NDArray[np.float64], Component]] = []
    carry = 0.0
    ordered = sorted(parts, key=lambda part: part.mass_share)
    for part in ordered:
        target = part.mass_share * mass + carry
        radius = _radii(part, target, rng)
        carry = target - part.density * SPHERE * float((radius**3).sum())
        drawn.append((radius, part))
    if not any(len(radius) for radius, _ in drawn):
        drawn[-1] = (ordered[-1].sizes.sample(1, rng) / 2.0, ordered[-1])
    return _interleave(drawn)


def _radii(part: Component, target: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Radii (K,), m, whose mass comes nearest to `target` kg."""
    if target <= 0.0:
        return np.zeros(0)
    grain = part.density * math.pi / 6.0 * part.sizes.number_mean_cube
    radius = part.sizes.sample(math.ceil(target / grain), rng) / 2.0
    while True:
        mass = part.density * SPHERE * radius**3
        upto = np.cumsum(mass)
        if upto[-1] >= target:
            return radius[upto - 0.5 * mass <= target]
        more = part.sizes.sample(math.ceil((target - upto[-1]) / grain), rng) / 2.0
        radius = np.concatenate([radius, more])


def _interleave(drawn: Sequence[tuple[NDArray[np.float64], Component]]) -> Draw:
    """All parts in one row, so that any stretch of it holds about the shares of the whole."""
    radius = np.concatenate([r for r, _ in drawn])
    density = np.concatenate([np.full(len(r), part.density) for r, part in drawn])
    row = np.concatenate([np.full(len(r), part.row, np.int32) for r, part in drawn])
    mass = density * SPHERE * radius**3
    place = []
    start = 0
    for r, _ in drawn:
        m = mass[start : start + len(r)]
        place.append((np.cumsum(m) - 0.5 * m) / max(float(m.sum()), 1e-300))
        start += len(r)
    order = np.argsort(np.concatenate(place), kind="stable")
    return Draw(radius[order], mass[order], density[order], row[order])

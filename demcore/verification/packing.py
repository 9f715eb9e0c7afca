"""How densely spheres pack when they are poured, three diameters away from every wall.

Source: random close packing of frictionless spheres, .62 to .65, and loose packing with friction, .57 to .61
(physics.md section 3). Sizes scatter by 10 %, so that the bed does not crystallise.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from demcore.case import Interaction
from demcore.particles import Floats, R, X, Z
from demcore.verification.beds import column, fall_time, run_to_rest, tube
from demcore.verification.outcome import SECTION_3, Outcome

DIAMETER = 0.01
TUBE = 6.5 * DIAMETER
COUNT = 2200
FROM_WALLS = 3.0 * DIAMETER
# Soft enough to be quick: the bed's weight presses the lowest contacts by a thousandth of a diameter.
YOUNGS = 5e6
POINTS = 400_000


def solid_fraction(position: Floats, radius: Floats, tube_radius: float, rng: np.random.Generator) -> float:
    """Share of random points inside a sphere, in the cylinder FROM_WALLS away from tube, floor and surface."""
    top = float(np.quantile(position[:, 2] + radius, 0.95)) - FROM_WALLS
    reach = tube_radius - FROM_WALLS
    rho, turn = reach * np.sqrt(rng.random(POINTS)), 2.0 * math.pi * rng.random(POINTS)
    points = np.column_stack(
        [rho * np.cos(turn), rho * np.sin(turn), FROM_WALLS + (top - FROM_WALLS) * rng.random(POINTS)]
    )
    points = points[np.argsort(points[:, 2])]
    inside = np.zeros(POINTS, bool)
    for centre, r in zip(position, radius, strict=True):
        low, high = np.searchsorted(points[:, 2], (centre[2] - r, centre[2] + r))
        inside[low:high] |= ((points[low:high] - centre) ** 2).sum(axis=1) < r * r
    return float(inside.mean())


def packing() -> Iterator[Outcome]:
    """Poured beds without and with friction."""
    for mu, lower, upper in ((0.0, 0.62, 0.65), (0.5, 0.57, 0.61)):
        rng = np.random.default_rng(12)
        radius = 0.5 * DIAMETER * rng.uniform(0.9, 1.1, COUNT)
        contact = Interaction(0.5, mu, mu, 0.0)
        s = column(radius, TUBE, 12, tube(TUBE), contact, youngs=YOUNGS)
        run_to_rest(s, fall_time(s) + 0.2, 5.0)
        state = s.particles.state
        got = solid_fraction(state[:, X : Z + 1], state[:, R], TUBE, rng)
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        yield Outcome(f"packing fraction, mu = {mu:g}", SECTION_3, middle, got, half)

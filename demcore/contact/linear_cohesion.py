"""Cohesion in proportion to the area of contact: F_c = k A (the simplified Johnson-Kendall-Roberts law, SJKR).

Source: LIGGGHTS' `cohesion sjkr`, which simplifies Johnson, Kendall and Roberts 1971 ("Surface energy and the
contact of elastic solids") to a constant cohesion energy density k over the circle in which the undeformed
spheres cut each other. Its area is pi a^2 with a^2 = 2 R s to first order in the overlap, R the effective
radius; the terms left out are of the order s/R.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from demcore.contact.model import Pair
from demcore.jit import leaf


class LinearCohesion(NamedTuple):
    """`energy_density` k, J/m3 (N/m2 of contact area), the same for all materials."""

    energy_density: float


@leaf
def linear_cohesion(law: LinearCohesion, pair: Pair, overlap: float) -> float:
    """Attraction, N, between two bodies that overlap by `overlap`, m."""
    return law.energy_density * 2.0 * math.pi * pair.radius * overlap

"""Cohesion of wet grains: the constant pull of a small liquid bridge, F_c = 4 pi R gamma cos(theta).

Source: the limit of a small bridge between touching spheres (Fisher 1926; Israelachvili, "Intermolecular and
Surface Forces", capillary condensation). It depends on neither overlap nor liquid volume. R is the effective
radius, so that two equal spheres of radius r pull with 2 pi r gamma cos(theta) and a sphere on a wall with
twice that. The rupture distance is left out: cohesion acts while two bodies touch, no longer.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from demcore.contact.model import Pair
from demcore.jit import leaf


class LiquidBridge(NamedTuple):
    """`surface_tension` gamma, N/m; `wetting` cos(theta) of the contact angle, 1 when the liquid spreads."""

    surface_tension: float = 0.072
    wetting: float = 1.0


@leaf
def liquid_bridge(law: LiquidBridge, pair: Pair, overlap: float) -> float:
    """Attraction, N, between two touching bodies."""
    return 4.0 * math.pi * pair.radius * law.surface_tension * law.wetting

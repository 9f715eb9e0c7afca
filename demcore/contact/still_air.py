"""Drag of still air (or another fluid at rest) on a sphere that moves through it alone.

Source: Schiller and Naumann 1935 for the drag coefficient, C = 24/Re (1 + .15 Re^.687), up to Re = 1000, and
Newton's constant .44 beyond; creeping rotation 8 pi eta r^3 w (Kirchhoff; Lamb, Hydrodynamics, section 334).
Crowding, lift and buoyancy are left out.

Re = rho |v| d / eta; rho density of the fluid, kg/m3; eta its viscosity, Pa s; d diameter, m.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from demcore.contact.model import Body, FieldWrench, Vec3
from demcore.jit import leaf

NEWTON_LIMIT = 1000.0
NEWTON_DRAG = 0.44


class StillAir(NamedTuple):
    """Air at 20 degrees C and 1 bar unless told."""

    density: float = 1.204
    viscosity: float = 1.82e-5


@leaf
def still_air(law: StillAir, body: Body) -> FieldWrench:
    """Drag, N, and the couple that slows the spin, N m."""
    v, w, r = body.velocity, body.spin, body.radius
    speed = math.sqrt(v.x * v.x + v.y * v.y + v.z * v.z)
    reynolds = 2.0 * law.density * speed * r / law.viscosity
    if reynolds <= NEWTON_LIMIT:
        # 1/2 rho C pi r^2 |v| with C = 24/Re (...) is Stokes' 6 pi eta r (...), which is finite at rest.
        resistance = 6.0 * math.pi * law.viscosity * r * (1.0 + 0.15 * reynolds**0.687)
    else:
        resistance = 0.5 * law.density * NEWTON_DRAG * math.pi * r * r * speed
    turning = 8.0 * math.pi * law.viscosity * r * r * r
    return FieldWrench(
        Vec3(-resistance * v.x, -resistance * v.y, -resistance * v.z),
        Vec3(-turning * w.x, -turning * w.y, -turning * w.z),
    )

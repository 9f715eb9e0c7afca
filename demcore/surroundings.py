"""What else acts on grains than other grains and walls: water on their surface, the air that they move through.

Plain data, importable without numba; `case_run.contact_model` turns it into laws.
"""

from __future__ import annotations

from dataclasses import dataclass

from demcore.allowed import positive, within


@dataclass(frozen=True)
class Water:
    """Liquid bridges between grains that touch: `surface_tension` gamma in N/m of the simulated grains (see
    `at_scale`), `wetting` cos(theta) of the contact angle. Law and source: contact/liquid_bridge.py.

    Raises InputError for a tension outside 0 to 1000 N/m (a coarse grain's exceeds any liquid's, as is meant) and
    a wetting outside 0 to 1.
    """

    surface_tension: float = 0.072
    wetting: float = 1.0

    def __post_init__(self) -> None:
        within("water.surface_tension", self.surface_tension, 0.0, 1000.0, "N/m")
        within("water.wetting", self.wetting, 0.0, 1.0)

    def at_scale(self, scale: float) -> Water:
        """For grains `scale` times as large with the same ratio of bridge force to weight.

        The Bond number 1.5 gamma / (rho g r^2) of the grain with radius r stays, so gamma grows with scale^2
        (diagnosis.md, library of effects).
        """
        return Water(self.surface_tension * scale**2, self.wetting)


@dataclass(frozen=True)
class Air:
    """A fluid at rest that brakes what moves through it: `density` kg/m3, `viscosity` Pa s; air at 20 degrees C
    and 1 bar unless told. Law and source: contact/still_air.py. Raises InputError for what is not positive."""

    density: float = 1.204
    viscosity: float = 1.82e-5

    def __post_init__(self) -> None:
        positive("air.density", self.density, "kg/m3")
        positive("air.viscosity", self.viscosity, "Pa s")

    def at_scale(self, scale: float) -> Air:
        """For grains `scale` times as large with the same Reynolds number and ratio of drag to weight.

        Newton's drag goes with density r^2 and Stokes' with viscosity r, the weight with r^3; so the density grows
        with the scale and the viscosity with its square.
        """
        return Air(self.density * scale, self.viscosity * scale**2)

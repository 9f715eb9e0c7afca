"""How a pile test departs from the ideal one: what the lab did, or what our picture of it leaves out.

Every default is the ideal test of the paper, to the bit. Importable without numba.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from demcore.allowed import not_negative, within
from demcore.errors import InputError
from demcore.geometry.walls import Oscillation
from demcore.surroundings import Air, Water

STANDARD_G = 9.81


@dataclass(frozen=True)
class Vibration:
    """The base swings up and down from the cylinder's removal on, for whole periods of about `duration` s.

    `acceleration` is the largest, in g (Gamma = A w^2 / g; above 1 a bed is thrown up), `frequency` in Hz.
    Raises InputError for a number outside 0 to 5, 1 to 200 Hz, .05 to 10 s.
    """

    acceleration: float
    frequency: float = 30.0
    duration: float = 1.0

    def __post_init__(self) -> None:
        within("vibration.acceleration", self.acceleration, 0.0, 5.0, "g")
        within("vibration.frequency", self.frequency, 1.0, 200.0, "Hz")
        within("vibration.duration", self.duration, 0.05, 10.0, "s")

    @property
    def seconds(self) -> float:
        """Whole periods, so that the base ends where it began."""
        return max(round(self.duration * self.frequency), 1) / self.frequency

    @property
    def oscillation(self) -> Oscillation:
        """Of the base."""
        amplitude = self.acceleration * STANDARD_G / (2.0 * math.pi * self.frequency) ** 2
        return Oscillation((0.0, 0.0, amplitude), self.frequency)


@dataclass(frozen=True)
class PileSetting:
    """water, air              those of the real grains; a coarse-grained test scales them (surroundings.py)
    base_friction_added     static friction of the base less that of the cylinder's wall
    cylinder_offset         m, of the cylinder's axis from the base's, along x and y
    drop_height             m, that the grains have fallen before the fall inside the cylinder that every test has
    vibration               of the base, after the cylinder went

    Raises InputError for a friction outside -10 to 10 and for a length that is negative or absurd.
    """

    water: Water | None = None
    air: Air | None = None
    base_friction_added: float = 0.0
    cylinder_offset: tuple[float, float] = (0.0, 0.0)
    drop_height: float = 0.0
    vibration: Vibration | None = None

    def __post_init__(self) -> None:
        within("setting.base_friction_added", self.base_friction_added, -10.0, 10.0)
        if len(self.cylinder_offset) != 2:
            raise InputError(
                "setting.cylinder_offset", self.cylinder_offset, "two lengths in m, along x and y"
            )
        for part in self.cylinder_offset:
            within("setting.cylinder_offset", part, -10.0, 10.0, "m")
        not_negative("setting.drop_height", self.drop_height, "m")
        within("setting.drop_height", self.drop_height, 0.0, 50.0, "m")

    @property
    def impact_speed(self) -> float:
        """m/s, with which the grains enter the cylinder."""
        return math.sqrt(2.0 * STANDARD_G * self.drop_height)

    @property
    def shaking_seconds(self) -> float:
        """s, after the removal in which nothing can lie still."""
        return 0.0 if self.vibration is None else self.vibration.seconds

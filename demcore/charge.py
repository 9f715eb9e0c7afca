"""What is put into a simulation: fills at its start and feeds while it runs. Plain data."""

from __future__ import annotations

import math
from dataclasses import dataclass

from demcore.allowed import Triple, natural, not_negative, positive, vector
from demcore.errors import InputError
from demcore.material import MixPart, check_mix
from demcore.region import Box, Inlet, Region

AT_REST: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Fill:
    """Particles that lie loosely in `region` when the simulation starts, none overlapping.

    How much: `mass` (kg), or `level` (z, m): what the region holds up to there at the materials' bulk density.
    A loose fill takes about twice the room of the bed that it settles to, so the region must be taller than
    the level. `velocity` m/s; `seed` its own random stream.
    """

    region: Region
    mix: tuple[MixPart, ...]
    mass: float | None = None
    level: float | None = None
    velocity: Triple = AT_REST
    seed: int = 0

    def __post_init__(self) -> None:
        check_mix("fill.mix", self.mix)
        if isinstance(self.region, Box) and not self.region.is_bounded:
            raise InputError("fill.region", self.region, "a box with finite sides")
        if (self.mass is None) == (self.level is None):
            raise InputError("fill.mass", self.mass, "either a mass in kg or a level in m")
        if self.mass is not None:
            positive("fill.mass", self.mass, "kg")
        if self.level is not None and not self.region.bottom < self.level <= self.region.top:
            allowed = f"above {self.region.bottom:g} m, at most {self.region.top:g} m, inside the region"
            raise InputError("fill.level", self.level, allowed)
        vector("fill.velocity", self.velocity, "m/s")
        natural("fill.seed", self.seed)


@dataclass(frozen=True)
class Feed:
    """Particles that come through `inlet` at `rate` (kg/s) from `start` (s) until `stop` (s) or until `mass` (kg)
    has come, whichever is first; at least one of them is given. `velocity` m/s; `seed` its own random stream."""

    inlet: Inlet
    mix: tuple[MixPart, ...]
    rate: float
    start: float = 0.0
    stop: float = math.inf
    mass: float = math.inf
    velocity: Triple = AT_REST
    seed: int = 0

    def __post_init__(self) -> None:
        check_mix("feed.mix", self.mix)
        positive("feed.rate", self.rate, "kg/s")
        not_negative("feed.start", self.start, "s")
        if not self.stop > self.start:
            raise InputError("feed.stop", self.stop, f"later than the start at {self.start:g} s")
        if not self.mass > 0.0:
            raise InputError("feed.mass", self.mass, "a positive number of kg")
        if math.isinf(self.stop) and math.isinf(self.mass):
            raise InputError("feed.stop", self.stop, "a time in s, or a mass in kg after which the feed ends")
        vector("feed.velocity", self.velocity, "m/s")
        natural("feed.seed", self.seed)

    @property
    def total(self) -> float:
        """kg that are to come altogether."""
        return min(self.mass, self.rate * (self.stop - self.start))

"""What a charge will cost, in steps, particles and wall clock, told before it starts. Importable without numba."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from demcore.experiments.charge_case import ChargeTest

DAY = 86_400.0


class Rate(NamedTuple):
    """What a machine does: particle-steps a second between two searches for neighbours, how long a search of so
    many grains takes, s (0: the particle-steps include it), and what a step costs whatever its grains are, s (0:
    as for the search). `source` says where the numbers come from."""

    particle_steps: float
    search_seconds: float = 0.0
    grains: int = 1
    source: str = "as measured here"
    step_seconds: float = 0.0


@dataclass(frozen=True)
class Cost:
    """What a charge will take. `present` is the number of grains on average, `searches` for their neighbours: the
    jet is so fast that these count."""

    particles: int
    steps: int
    present: float
    searches: int
    rate: Rate

    @property
    def particle_steps(self) -> float:
        return self.present * self.steps

    @property
    def seconds(self) -> float:
        """Of wall clock. A search of few grains takes as long as that of the bed on which it was timed."""
        search = self.rate.search_seconds * max(1.0, self.present / self.rate.grains)
        return self._moving_seconds + self.searches * search

    @property
    def _moving_seconds(self) -> float:
        return self.particle_steps / self.rate.particle_steps + self.steps * self.rate.step_seconds

    def sentence(self) -> str:
        """For a person, with a warning where it would take days."""
        search = ""
        if self.rate.search_seconds > 0.0:
            search = f" and {1e3 * self.rate.search_seconds:.1f} ms for each of {self.searches} searches"
        told = (
            f"about {self.particles} grains, {self.steps} steps, {self.particle_steps:.1e} particle-steps; at "
            f"{self.particle_steps / self._moving_seconds:.1e} a second{search}, {self.rate.source}, "
            f"{_duration(self.seconds)}"
        )
        if self.seconds < DAY:
            return told
        factor = math.ceil(10.0 * (self.seconds / 3600.0) ** 0.25) / 10.0
        return (
            f"{told}. THAT IS DAYS: {factor:g} times as coarse takes an hour (cost falls with the 4th power)"
        )


def _duration(seconds: float) -> str:
    for unit, size in (("days", DAY), ("h", 3600.0), ("min", 60.0)):
        if seconds >= size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.0f} s"


def charge_cost(test: ChargeTest, rate: Rate, searches: int = 0) -> Cost:
    """Grains come evenly and stay, so half of them are there on average while they come, all of them at rest."""
    present = test.expected_particles * (0.5 * test.charge.duration + test.rest_seconds) / test.seconds
    return Cost(test.expected_particles, math.ceil(test.seconds / test.case.dt), present, searches, rate)

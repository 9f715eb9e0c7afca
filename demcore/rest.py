"""When a bed is at rest: its rms speed has stayed below a share of sqrt(g d) for some time."""

from __future__ import annotations

import math

from demcore.case import RestCriterion
from demcore.particles import VX, VZ, M, R
from demcore.simulation import Simulation


def rms_speed(simulation: Simulation) -> float:
    """m/s, weighted by mass; 0 for an empty bed."""
    state = simulation.particles.state
    if len(state) == 0:
        return 0.0
    energy = float((state[:, M] * (state[:, VX : VZ + 1] ** 2).sum(axis=1)).sum())
    return math.sqrt(energy / float(state[:, M].sum()))


class RestWatch:
    """Follows a bed from check to check; `since` is the step at which it came to lie still, -1 while it moves."""

    def __init__(self, criterion: RestCriterion, gravity: float) -> None:
        self.criterion = criterion
        self.gravity = gravity
        self.since = -1

    def speed_limit(self, simulation: Simulation) -> float:
        """m/s: speed_share sqrt(g d), d the diameter of the particle of mean volume."""
        radius = simulation.particles.state[:, R]
        if len(radius) == 0:
            return 0.0
        diameter = 2.0 * float((radius**3).mean()) ** (1.0 / 3.0)
        return self.criterion.speed_share * math.sqrt(self.gravity * diameter)

    def look(self, simulation: Simulation, may_rest: bool = True) -> bool:
        """One check; True when the bed has lain still for long enough. `may_rest` False starts anew."""
        if not may_rest or rms_speed(simulation) > self.speed_limit(simulation):
            self.since = -1
            return False
        if self.since < 0:
            self.since = simulation.step
        return (simulation.step - self.since) * simulation.dt >= self.criterion.duration

    def sentence(self) -> str:
        """The criterion, for the record of a run."""
        c = self.criterion
        return f"rms speed below {c.speed_share:g} sqrt(g d) for {c.duration:g} s, d the mean diameter"

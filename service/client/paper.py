"""What the paper found for its materials (Degrassi et al. 2021, Tables 5, 6 and 7), to stand beside a study.

The paper's simulations: the total, and of it those with an angle inside the window, outside, and crashed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class PaperResult:
    """One column of Tables 5 to 7."""

    optimum: Mapping[str, float]
    feasible: int
    unfeasible: int
    error: int
    repeats_deg: tuple[float, float, float]

    @property
    def total(self) -> int:
        return self.feasible + self.unfeasible + self.error


def _optimum(particles: float, wall: float, restitution: float, rolling: float) -> dict[str, float]:
    return {
        "particle_particle_static_friction": particles,
        "particle_wall_static_friction": wall,
        "particle_particle_restitution": restitution,
        "rolling_resistance": rolling,
    }


PAPER: Mapping[str, PaperResult] = {
    "coke": PaperResult(_optimum(0.50, 0.80, 0.24, 0.48), 11, 15, 0, (37.7, 37.1, 36.6)),
    "sinter": PaperResult(_optimum(0.40, 0.40, 0.40, 0.24), 11, 38, 6, (31.5, 32.5, 31.5)),
    "pellet": PaperResult(_optimum(0.40, 0.40, 0.20, 0.20), 2, 13, 1, (25.6, 25.0, 24.4)),
}

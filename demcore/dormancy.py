"""Dormancy: when a particle of a bed at rest may be left out of the computation, and when it comes back.

Importable without numba. What is done with it: demcore/dormant.py and docs/decisions.
"""

from __future__ import annotations

from dataclasses import dataclass

from demcore.allowed import positive, within
from demcore.errors import InputError


@dataclass(frozen=True)
class Dormancy:
    """A particle falls dormant, held where it is, once for `duration_share` sqrt(d/g) on end its speed and that of
    its surface by spin have stayed below `speed_share` sqrt(g d) and the force on it below `force_share` of its
    load, and while its contacts at standstill balance its weight to that share. It wakes when the force on it has
    changed by more than `wake_share` of its load (a torque: of load times radius). d its diameter; its load is its
    weight or, if more, half the sum of its contacts' forces: friction holds in proportion to what presses."""

    speed_share: float = 0.005
    force_share: float = 0.15
    wake_share: float = 0.3
    duration_share: float = 0.5

    def __post_init__(self) -> None:
        within("dormancy.speed_share", self.speed_share, 0.0, 0.1, "shares of sqrt(g d)")
        within("dormancy.force_share", self.force_share, 0.0, 0.5, "shares of the load")
        within("dormancy.wake_share", self.wake_share, 0.0, 0.5, "shares of the load")
        positive("dormancy.duration_share", self.duration_share, "shares of sqrt(d / g)")
        if self.wake_share < self.force_share:
            allowed = f"{self.force_share:g} or more: less wakes what has just fallen dormant"
            raise InputError("dormancy.wake_share", self.wake_share, allowed)

    def sentence(self) -> str:
        """The criterion, for the record of a run."""
        return (
            f"particles slower than {self.speed_share:g} sqrt(g d), out of balance by less than "
            f"{self.force_share:g} of their load (their weight or half the sum of their contacts' forces) for "
            f"{self.duration_share:g} sqrt(d / g) are held until the force on them changes by more than "
            f"{self.wake_share:g} of it"
        )

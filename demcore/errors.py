"""What can go wrong in demcore, as types that a caller can tell apart.

A wrong input is an `InputError` that names the field, the value and what is allowed; a simulation that
cannot give a trustworthy number is a `SimulationError` with its class in `kind`.
"""

from __future__ import annotations

from pathlib import Path


class InputError(ValueError):
    """A value outside its allowed range: `field`, `value` and `allowed` say which, what and why."""

    def __init__(self, field: str, value: object, allowed: str) -> None:
        super().__init__(f"{field}: got {value!r}, allowed is {allowed}")
        self.field = field
        self.value = value
        self.allowed = allowed


class SimulationError(RuntimeError):
    """A run that gives no trustworthy number. `kind` is the failure class that studies store."""

    kind = "error"


class BlowUp(SimulationError):
    """A number is no longer finite, or a particle moves or overlaps beyond what the model can mean.

    `particle` is its number, `time` the simulated s, `checkpoint` the last good one's path, None without one.
    """

    kind = "blow_up"

    def __init__(self, what: str, particle: int | None = None, time: float | None = None) -> None:
        super().__init__(what)
        self.what = what
        self.particle = particle
        self.time = time
        self.checkpoint: Path | None = None

    def __str__(self) -> str:
        where = "" if self.particle is None else f"particle {self.particle} "
        when = "" if self.time is None else f" at {self.time:.4f} s"
        kept = "" if self.checkpoint is None else f"; the last good checkpoint is {self.checkpoint}"
        return f"{where}{self.what}{when}{kept}"


class NeverSettles(SimulationError):
    """The bed or the pile still moves when the simulated time is over."""

    kind = "never_settles"


class NoResult(SimulationError):
    """The simulation ended, but there is nothing to measure (no pile on the base)."""

    kind = "no_result"


class Cancelled(SimulationError):
    """The caller asked to stop."""

    kind = "cancelled"

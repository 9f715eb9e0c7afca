"""What can go wrong in demcore, as types that a caller can tell apart.

A wrong input is an `InputError` that names the field, the value and what is allowed; a simulation that
cannot give a trustworthy number is a `SimulationError` with its class in `kind`.
"""

from __future__ import annotations


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
    """A number is no longer finite, or a particle moves or overlaps beyond what the model can mean."""

    kind = "blow_up"


class NeverSettles(SimulationError):
    """The bed or the pile still moves when the simulated time is over."""

    kind = "never_settles"


class NoResult(SimulationError):
    """The simulation ended, but there is nothing to measure (no pile on the base)."""

    kind = "no_result"


class Cancelled(SimulationError):
    """The caller asked to stop."""

    kind = "cancelled"

"""Running a case: one loop for every program, progress, cancelling, checkpoints, and a recorder for its frames."""

from __future__ import annotations

from typing import Protocol

from demcore.simulation import Simulation


class Recorder(Protocol):
    """Writes what a run looks like while it runs, a time series for ParaView for instance.

    `interval` is the simulated time between two frames, s. The first frame is at time 0, the last one at the end
    of the run, even off the interval. Frames come at whole steps in order of time; `frame` reads the simulation
    (particles.state, .number and .material, walls, step) and changes nothing in it.
    """

    interval: float

    def frame(self, time: float, simulation: Simulation) -> None:
        """Write the state at `time`, s."""

    def rewind(self, time: float) -> None:
        """A run was resumed at `time`, s: frames later than that will come again, so forget those written."""

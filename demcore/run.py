"""Running a case: one loop for every program, progress, cancelling, checkpoints, and a recorder for its frames."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from demcore.case import Case
from demcore.case_run import CaseRun
from demcore.errors import BlowUp, Cancelled
from demcore.result import Result, finished
from demcore.simulation import Simulation

# Wall-clock seconds: of a chunk of steps, and between two reports. A cancel is heard after both at the latest.
CHUNK_SECONDS = 0.2
REPORT_SECONDS = 0.25
# A chunk grows at most so fast: what a step costs is known only once some were made.
CHUNK_GROWTH = 4


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


@dataclass(frozen=True)
class Progress:
    """What a run reports a few times a second. Times in s; fraction of the work done is an estimate."""

    phase: str
    time_s: float
    particles: int
    kinetic_energy_j: float
    particle_steps_per_s: float
    fraction: float
    seconds_left: float


OnProgress = Callable[[Progress], bool | None]


def simulate(
    case: Case,
    on_progress: OnProgress | None = None,
    *,
    threads: int = 1,
    checkpoint_path: Path | None = None,
    checkpoint_seconds: float = 30.0,
    recorder: Recorder | None = None,
) -> Result:
    """Run a case to its end; the same case gives the same bits on any number of threads, resumed or not.

    `on_progress` is called a few times a second at most, and stops the run by returning False. With
    `checkpoint_path` the run saves itself every `checkpoint_seconds` of wall clock and when it is stopped, and
    goes on from there when called again. Raises InputError for a fill that does not fit, Cancelled, and BlowUp
    with the particle, the time and the last good checkpoint (demcore.errors).
    """
    run = CaseRun(case, threaded=threads > 1)
    drive(run, on_progress, checkpoint_path, checkpoint_seconds, recorder)
    return finished(run)


def drive(
    run: CaseRun,
    on_progress: OnProgress | None = None,
    checkpoint_path: Path | None = None,
    checkpoint_seconds: float = 30.0,
    recorder: Recorder | None = None,
) -> None:
    """Advance a run in chunks until it has ended, from its newest checkpoint if it has one."""
    resumed = checkpoint_path is not None and run.resume(checkpoint_path)
    loop = _Loop(run, on_progress, checkpoint_path, checkpoint_seconds, recorder)
    try:
        loop.begin(resumed)
        while not run.ended:
            loop.turn()
        loop.end()
    except BlowUp as error:
        if resumed or loop.has_saved:
            error.checkpoint = checkpoint_path
        raise


class _Loop:
    """The clock's side of a run: how long a chunk is, when to report and to save. None of it touches physics."""

    def __init__(
        self,
        run: CaseRun,
        on_progress: OnProgress | None,
        path: Path | None,
        save_seconds: float,
        recorder: Recorder | None,
    ) -> None:
        self.run, self.on_progress, self.path, self.recorder = run, on_progress, path, recorder
        self.save_seconds = save_seconds
        self.has_saved = False
        self.chunk = 1
        self.rate = 0.0
        self.started = self.saved = time.monotonic()
        self.spent_before = run.wall_seconds
        self.reported = -math.inf
        self.frame_steps = 0 if recorder is None else max(1, round(recorder.interval / run.simulation.dt))
        self.framed = -1

    def begin(self, resumed: bool) -> None:
        """The first frame, or the recorder's way back to where the run goes on."""
        if resumed and self.recorder is not None:
            self.recorder.rewind(self.run.simulation.time)
        if not resumed or self.run.simulation.step % max(self.frame_steps, 1) == 0:
            self._frame()

    def turn(self) -> None:
        """One chunk, what is due after it, and a word to the caller."""
        run, s = self.run, self.run.simulation
        steps = min(self.chunk, run.steps_to_event())
        if self.frame_steps:
            steps = min(steps, self.frame_steps - s.step % self.frame_steps)
        clock, count = time.perf_counter(), s.count
        s.advance(steps)
        self._pace(steps, count, time.perf_counter() - clock)
        run.act()
        if self.frame_steps and s.step % self.frame_steps == 0:
            self._frame()
        now = time.monotonic()
        run.wall_seconds = self.spent_before + now - self.started
        # Not of the end: its report comes once, from end(), and a time is reported once.
        if self.on_progress is not None and not run.ended and now - self.reported >= REPORT_SECONDS:
            self._report()
            self.reported = time.monotonic()
        if self.path is not None and not run.ended and now - self.saved >= self.save_seconds:
            run.save(self.path)
            self.has_saved, self.saved = True, time.monotonic()

    def end(self) -> None:
        """The last frame and the last report."""
        self._frame()
        if self.on_progress is not None:
            self.on_progress(self._progress())

    def _pace(self, steps: int, count: int, spent: float) -> None:
        """How long the next chunk may be, so that none takes much longer than CHUNK_SECONDS."""
        if spent > 0.0:
            self.rate = steps * count / spent
            fitting = int(steps * CHUNK_SECONDS / spent)
            self.chunk = max(1, min(CHUNK_GROWTH * self.chunk, fitting))

    def _frame(self) -> None:
        if self.recorder is not None and self.framed != self.run.simulation.step:
            self.recorder.frame(self.run.simulation.time, self.run.simulation)
            self.framed = self.run.simulation.step

    def _report(self) -> None:
        assert self.on_progress is not None
        if self.on_progress(self._progress()) is not False:
            return
        where = ""
        if self.path is not None:
            self.run.save(self.path)
            where = f"; checkpoint {self.path}"
        raise Cancelled(f"stopped on request at {self.run.simulation.time:.3f} s{where}")

    def _progress(self) -> Progress:
        run, s = self.run, self.run.simulation
        done = run.plan.fraction(run)
        left = run.wall_seconds * (1.0 - done) / done if done > 0.02 else math.nan
        return Progress(run.plan.phase, s.time, s.count, s.kinetic_energy, self.rate, done, left)

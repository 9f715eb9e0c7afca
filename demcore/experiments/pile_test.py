"""The paper's conical pile test as a program over the parts: run to rest, report, save, measure."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from demcore.errors import Cancelled, NoResult
from demcore.experiments.pile_case import PileTest
from demcore.experiments.pile_result import PileResult, measure_pile
from demcore.experiments.pile_run import PileRun

CHECK_INTERVAL = 0.01
WALL_CLOCK_CHUNK = 0.2


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


OnProgress = Callable[[Progress], bool]


def run_pile_test(
    test: PileTest,
    on_progress: OnProgress | None = None,
    threads: int = 1,
    checkpoint_path: Path | None = None,
    checkpoint_seconds: float = 30.0,
) -> PileResult:
    """Run the test and measure the pile; same test and seed, same bits, on any number of threads.

    `on_progress` is called a few times a second and stops the run by returning False. With `checkpoint_path` the
    run saves itself every `checkpoint_seconds` and when it is stopped, and continues from there when called again.
    Raises Cancelled, BlowUp, NeverSettles or NoResult (demcore.errors).
    """
    run = PileRun(test, threaded=threads > 1)
    if checkpoint_path is not None:
        run.resume(checkpoint_path)
    _drive(run, on_progress, checkpoint_path, checkpoint_seconds)
    if run.simulation.count == 0:
        raise NoResult("every particle left the base: no pile to measure")
    return measure_pile(run)


def _drive(run: PileRun, on_progress: OnProgress | None, path: Path | None, seconds: float) -> None:
    """Advance in chunks of about WALL_CLOCK_CHUNK seconds until the pile is at rest."""
    s = run.simulation
    interval = max(1, round(CHECK_INTERVAL / s.dt))
    chunk, rate = 50, 0.0
    before, saved = run.wall_seconds, time.monotonic()
    started = saved
    while True:
        steps = min(chunk, interval - s.step % interval)
        clock, count = time.perf_counter(), s.count
        s.advance(steps)
        spent = time.perf_counter() - clock
        run.particle_steps += steps * count
        run.wall_seconds = before + time.monotonic() - started
        if spent > 0.0:
            rate = steps * count / spent
            chunk = max(1, min(interval, int(steps * WALL_CLOCK_CHUNK / spent)))
        finished = s.step % interval == 0 and run.check()
        if on_progress is not None and not on_progress(_report(run, rate)):
            if path is not None:
                run.save(path)
            raise Cancelled(f"stopped on request at {s.time:.3f} s")
        if finished:
            return
        if path is not None and time.monotonic() - saved >= seconds:
            run.save(path)
            saved = time.monotonic()


def _report(run: PileRun, rate: float) -> Progress:
    s, done = run.simulation, run.fraction()
    left = run.wall_seconds * (1.0 - done) / done if done > 0.02 else math.nan
    return Progress(run.phase, s.time, s.count, s.kinetic_energy, rate, done, left)

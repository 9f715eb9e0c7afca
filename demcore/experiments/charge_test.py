"""The charge of the hopper as a short program over the parts: a case, a plan, the loop, a measurement."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path

from demcore.case import Case
from demcore.case_run import CaseRun
from demcore.charge import Fill
from demcore.experiments.charge_case import ChargeTest
from demcore.experiments.charge_cost import Cost, Rate, charge_cost
from demcore.experiments.charge_result import ChargeResult, measure_charge
from demcore.experiments.charge_run import ChargePlan
from demcore.geometry.walls import Wall
from demcore.neighbours import LONGEST_LOOK
from demcore.region import cylinder
from demcore.run import OnProgress, Recorder, drive

# The bed on which the rate is taken: grains, and wall-clock seconds to settle and to time it.
RATE_GRAINS = 600
SETTLE_WALL_SECONDS, TIMED_WALL_SECONDS, TIMED_SEARCHES = 3.0, 1.0, 20


def run_charge(
    test: ChargeTest,
    on_progress: OnProgress | None = None,
    threads: int = 1,
    checkpoint_path: Path | None = None,
    checkpoint_seconds: float = 30.0,
    recorder: Recorder | None = None,
) -> ChargeResult:
    """Run the charge and measure the burden; same test and seed, same bits, on any number of threads.

    `on_progress`, `checkpoint_path` and `recorder` are those of demcore.run.simulate.
    Raises Cancelled, BlowUp or NoResult (demcore.errors).
    """
    plan = ChargePlan(test)
    run = CaseRun(test.case, plan, threads > 1, program=test)
    drive(run, on_progress, checkpoint_path, checkpoint_seconds, recorder)
    return measure_charge(test, run, plan)


def estimate_cost(test: ChargeTest, rate: Rate | None = None) -> Cost:
    """What the charge costs at `rate`, by default measured now.

    While the jet falls, a search is due when its grains have gone as far as they looked ahead, and often before:
    when grains are born, and when one is hit. Iron at scales 4 and 10 had 1.4 and 1.8 in the time looked ahead.
    """
    searches = math.ceil(2.0 * test.charge.duration / (LONGEST_LOOK * test.case.dt))
    return charge_cost(test, measure_rate(test) if rate is None else rate, searches)


def rate_case(test: ChargeTest) -> Case:
    """A few hundred of the charge's grains that fall into a tube."""
    volume = sum(
        part.mass_share / g.particle_density for part, g in zip(test.charge.mix, test.grains, strict=True)
    )
    mass = test.charge.mass * min(1.0, RATE_GRAINS / test.expected_particles)
    largest = max(g.sizes.largest for g in test.grains)
    radius = max(2.0 * largest, (mass * volume) ** (1.0 / 3.0))
    height = 8.0 * mass * volume / (math.pi * radius**2) + 4.0 * largest
    fill = Fill(cylinder((0.0, 0.0, 0.0), radius, height), test.charge.mix, mass)
    walls = (Wall("plane"), Wall("cylinder", radius=radius, length=height))
    return replace(test.case, walls=walls, feeds=(), fills=(fill,), domain=None)


def measure_rate(test: ChargeTest) -> Rate:
    """The rate of this machine now, on a small bed of the charge's grains."""
    run = CaseRun(rate_case(test))
    s = run.simulation
    s.advance(1)
    # Compiled by now. Until it lies, or for so long.
    falls = math.ceil(math.sqrt(2.0 * run.case.fills[0].region.top / 9.81) / s.dt)
    started = time.perf_counter()
    while s.step < falls and time.perf_counter() - started < SETTLE_WALL_SECONDS:
        s.advance(100)
    started = time.perf_counter()
    for _ in range(TIMED_SEARCHES):
        s.stale = True
        s.advance(1)
    search = (time.perf_counter() - started) / TIMED_SEARCHES
    started, before = time.perf_counter(), s.particle_steps
    while (spent := time.perf_counter() - started) < TIMED_WALL_SECONDS:
        s.advance(100)
    return Rate((s.particle_steps - before) / spent, search, s.count)

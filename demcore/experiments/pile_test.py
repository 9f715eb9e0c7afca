"""The paper's conical pile test as a short program over the parts: a case, a plan, the loop, a measurement."""

from __future__ import annotations

from pathlib import Path

from demcore.case_run import CaseRun
from demcore.errors import NoResult
from demcore.experiments.pile_case import PileTest
from demcore.experiments.pile_result import PileResult, measure_pile
from demcore.experiments.pile_run import PilePlan
from demcore.run import OnProgress, Recorder, drive


def run_pile_test(
    test: PileTest,
    on_progress: OnProgress | None = None,
    threads: int = 1,
    checkpoint_path: Path | None = None,
    checkpoint_seconds: float = 30.0,
    recorder: Recorder | None = None,
) -> PileResult:
    """Run the test and measure the pile; same test and seed, same bits, on any number of threads.

    `on_progress`, `checkpoint_path` and `recorder` are those of demcore.run.simulate.
    Raises Cancelled, BlowUp, NeverSettles or NoResult (demcore.errors).
    """
    plan = PilePlan(test)
    run = CaseRun(test.case, plan, threads > 1, program=test)
    drive(run, on_progress, checkpoint_path, checkpoint_seconds, recorder)
    if run.simulation.count == 0:
        raise NoResult("every particle left the base: no pile to measure")
    return measure_pile(test, run, plan)

"""Many pile tests on all cores, one thread each; what is finished is kept, what was stopped goes on.

Each trial NAME leaves NAME.h5 (pile_file.py). Called again, a trial whose file is there and describes the same
test is read instead of run.
"""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

from demcore import checkpoint
from demcore.errors import Cancelled, InputError, SimulationError
from demcore.experiments.paper_tables import Trial
from demcore.experiments.pile_case import PileTest
from demcore.experiments.pile_file import describe_test, write_pile
from demcore.experiments.pile_test import run_pile_test
from demcore.output.result_file import PACKAGE, read_result
from demcore.source_hash import hash_sources
from demcore.stop_signals import stop_signals

CHECKPOINT_SECONDS = 60.0


@dataclass(frozen=True)
class Outcome:
    """`summary` of the result file; None where the run failed, as `failure` says. `by_other_code`: the file was
    there, and was written by other sources than today's."""

    trial: Trial
    summary: dict[str, Any] | None
    failure: str = ""
    was_there: bool = False
    by_other_code: bool = False

    @property
    def angle_deg(self) -> float:
        """The scanned repose angle; nan for a run that failed."""
        return float("nan") if self.summary is None else float(self.summary["angle_deg"])


def run_trials(
    trials: Sequence[Trial], folder: Path, processes: int, report: Callable[[Outcome], None]
) -> list[Outcome]:
    """Run what is not there yet; outcomes in the order of the trials, each reported as soon as it is known.

    Ctrl-C lets the running trials save themselves, then raises KeyboardInterrupt. Raises InputError when two
    trials share a name.
    """
    names = [trial.name for trial in trials]
    if len(set(names)) < len(names):
        raise InputError("trials", sorted({n for n in names if names.count(n) > 1}), "names of their own")
    outcomes: dict[str, Outcome] = {}
    missing = []
    for trial in trials:
        found = stored_outcome(trial, folder)
        if found is None:
            missing.append(trial)
        else:
            outcomes[trial.name] = found
            report(found)
    if missing:
        compile_kernels(missing[0].test)
        for outcome in _run_all(missing, folder, min(processes, len(missing))):
            outcomes[outcome.trial.name] = outcome
            report(outcome)
    return [outcomes[name] for name in names]


def stored_outcome(trial: Trial, folder: Path) -> Outcome | None:
    """What a file of this very test says; None when there is none."""
    path = folder / f"{trial.name}.h5"
    if not path.exists():
        return None
    try:
        stored = read_result(path)
    except InputError:
        return None
    if stored.case != describe_test(trial.test):
        return None
    other = stored.source_sha256 != hash_sources(PACKAGE)
    return Outcome(trial, stored.summary, was_there=True, by_other_code=other)


def compile_kernels(test: PileTest) -> None:
    """Make a first chunk of steps, so that the processes find compiled kernels in the cache.

    Ctrl-C is heard when they are there, as KeyboardInterrupt.
    """
    with stop_signals() as stopped, suppress(SimulationError):
        run_pile_test(test, on_progress=lambda _progress: False)
    if stopped:
        raise KeyboardInterrupt


def _run_all(trials: Sequence[Trial], folder: Path, processes: int) -> Iterator[Outcome]:
    # Spawned, not forked: the parent may hold threads of Numba's.
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    with ProcessPoolExecutor(processes, context, _prepare, (stop,)) as pool:
        running: dict[Future[Outcome], Trial] = {pool.submit(_run, t, folder): t for t in trials}
        try:
            for future in as_completed(running):
                try:
                    yield future.result()
                except BrokenProcessPool:
                    yield Outcome(running[future], None, "its process was killed")
        finally:
            # After Ctrl-C, or when the caller stops listening: nothing is left running behind its back.
            stop.set()
            pool.shutdown(wait=True, cancel_futures=True)


_stop: Event | None = None


def _prepare(stop: Event) -> None:
    """In each process: Ctrl-C is the parent's, which tells by the event."""
    global _stop
    _stop = stop
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _run(trial: Trial, folder: Path) -> Outcome:
    path = folder / f"{trial.name}.checkpoint"
    try:
        result = run_pile_test(
            trial.test,
            lambda _progress: _stop is None or not _stop.is_set(),
            checkpoint_path=path,
            checkpoint_seconds=CHECKPOINT_SECONDS,
        )
    except SimulationError as error:
        if not isinstance(error, Cancelled):
            checkpoint.discard(path)
        return Outcome(trial, None, f"{error.kind}: {error}")
    file = folder / f"{trial.name}.h5"
    write_pile(result, file)
    checkpoint.discard(path)
    return Outcome(trial, read_result(file).summary)

"""A run that a command keeps in a folder: its frames, its checkpoint, Ctrl-C, and --resume that goes on."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from demcore import checkpoint
from demcore.commands.arguments import check_at_least
from demcore.commands.quantity import parse_quantity
from demcore.identity import run_identity
from demcore.recorder import SeriesRecorder
from demcore.stop_signals import stop_signals

CHECKPOINT = "run.checkpoint"

Result = TypeVar("Result")


@dataclass(frozen=True)
class RunOptions:
    """How a run is kept; `frame_interval` s of simulated time, None for no frames."""

    threads: int
    resume: bool
    checkpoint_seconds: float
    frame_interval: float | None


def add_run_options(parser: argparse.ArgumentParser, folder: str, frames: str) -> None:
    """The arguments of `run_options`, and the folder for the files; `frames` is their usual interval."""
    parser.add_argument(
        "--frames",
        default=frames,
        help=f"simulated time between frames, or none (default {frames})",
    )
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path(folder), help="folder for the files")
    parser.add_argument("--resume", action="store_true", help="continue from the checkpoint in --out")
    parser.add_argument(
        "--checkpoint-seconds", type=float, default=10.0, help="between two saves (default 10)"
    )


def run_options(arguments: argparse.Namespace) -> RunOptions:
    """What the arguments say. Raises InputError."""
    from demcore.bench.rates import check_threads

    check_threads(arguments.threads)
    check_at_least("checkpoint_seconds", arguments.checkpoint_seconds, 0.0)
    interval = None if arguments.frames == "none" else parse_quantity("frames", arguments.frames, "time")
    return RunOptions(arguments.threads, arguments.resume, arguments.checkpoint_seconds, interval)


def run_kept(
    test: Any,
    experiment: Callable[..., Result],
    options: RunOptions,
    folder: Path,
    write: Callable[[Result, Path], None],
) -> Result:
    """Run the test by its `experiment` (run_pile_test or run_charge), or go on with it, and write its files.

    What a stopped run needs stays in the folder until then. Raises what the experiment raises.
    """
    path = folder / CHECKPOINT
    if not options.resume:
        checkpoint.discard(path)
    elif checkpoint.load_newest(path, run_identity(test.case, test)) is None:
        print(f"no checkpoint of this run in {folder}: it starts from its beginning", file=sys.stderr)
    recorder = None if options.frame_interval is None else SeriesRecorder(folder, options.frame_interval)
    result = _run(test, experiment, options, path, recorder)
    write(result, folder)
    if recorder is not None:
        recorder.finish()
    checkpoint.discard(path)
    if recorder is not None:
        recorder.discard_journal()
    return result


def _run(
    test: Any,
    experiment: Callable[..., Result],
    options: RunOptions,
    path: Path,
    recorder: SeriesRecorder | None,
) -> Result:
    import numba

    from demcore.commands.progress_bar import ProgressBar
    from demcore.run import Progress

    numba.set_num_threads(options.threads)
    with ProgressBar() as bar, stop_signals() as stopped:

        def show(progress: Progress) -> bool:
            bar.show(progress)
            return not stopped

        return experiment(test, show, options.threads, path, options.checkpoint_seconds, recorder)

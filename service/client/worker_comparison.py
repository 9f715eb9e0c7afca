"""Two workers of one thread against one worker of two: the same study on fresh data folders, in turns.

`make compare-workers`: prints the wall time of each; the defaults of TALUS_WORKERS and TALUS_THREADS are set by
it. The two give the same designs and the same angles, since results do not depend on threads or workers.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import click

LAYOUTS = {"two workers of one thread": (2, 1), "one worker of two threads": (1, 2)}


@dataclass(frozen=True)
class Timing:
    """One run of the demo's study, s: of the study itself, and with starting and compiling."""

    study_s: float
    whole_s: float
    simulations: int


def run_study(workers: int, threads: int, options: list[str]) -> Timing:
    """The demo's study in an installation of its own. Raises CalledProcessError where the demo fails."""
    with tempfile.TemporaryDirectory(prefix="talus-") as folder, socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
        probe.close()
        environment = {
            **os.environ,
            "TALUS_DATA_DIR": folder,
            "TALUS_PORT": str(port),
            "TALUS_WORKERS": str(workers),
            "TALUS_THREADS": str(threads),
        }
        command = [sys.executable, "-m", "service.cli", "demo", *options]
        began = time.monotonic()
        subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)
        whole_s = time.monotonic() - began
        outcome = json.loads((Path(folder) / "demo.json").read_text(encoding="utf-8"))
    return Timing(60.0 * outcome["minutes"], whole_s, sum(outcome["simulations"].values()))


@click.command()
@click.option("--material", default="pellet", show_default=True)
@click.option("--scale", type=float, default=3.0, show_default=True)
@click.option("--budget", type=int, default=6, show_default=True, help="simulations")
@click.option("--seed", type=int, default=1, show_default=True)
@click.option("--turns", type=click.IntRange(1, 10), default=1, show_default=True, help="of each layout")
def compare(material: str, scale: float, budget: int, seed: int, turns: int) -> None:
    """Time both layouts in turns on the same study; a first short one compiles for both."""
    study = ["--material", material, "--scale", str(scale), "--seed", str(seed)]
    for workers, threads in LAYOUTS.values():
        run_study(workers, threads, [*study, "--budget", "1"])
    for _ in range(turns):
        for name, (workers, threads) in LAYOUTS.items():
            timing = run_study(workers, threads, [*study, "--budget", str(budget)])
            click.echo(f"{name}: {timing.study_s:.0f} s for {timing.simulations} simulations")


if __name__ == "__main__":
    compare()

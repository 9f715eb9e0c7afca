"""Run by test_killed_run.py: a case with a fill, a feed and a moving wall, saved often, its result as a file.

python killed_program.py FOLDER PAUSE: PAUSE seconds of sleep at each report, so that somebody can kill it.
"""

from __future__ import annotations

import dataclasses
import json
import os
import sys
import time
from pathlib import Path

import numpy as np

from demcore import run as run_module
from demcore.case_run import CaseRun
from demcore.geometry.walls import Wall
from demcore.result import finished
from tests.demcore.cases import TUBE, a_case, a_feed, a_fill


def main(folder: Path, pause: float) -> None:
    folder.mkdir(exist_ok=True)
    case = a_case(
        fills=(a_fill(mass=0.3),),
        feeds=(a_feed(rate=0.8),),
        walls=(
            Wall("plane"),
            Wall("cylinder", radius=TUBE, length=9.0),
            Wall(
                "disc",
                (0.0, 0.0, 0.35),
                radius=0.03,
                velocity=(0.0, 0.0, -0.5),
                angular_velocity=(0.0, 0.0, 5.0),
            ),
        ),
        duration=0.5,
        rest=None,
    )
    run_module.REPORT_SECONDS = 0.0
    run_module.CHUNK_SECONDS = 0.01
    run = CaseRun(case)

    def report(progress: run_module.Progress) -> bool:
        # The checkpoint of the chunk before this one lies there already.
        with open(folder / f"times-{os.getpid()}", "a", encoding="utf-8") as file:
            file.write(f"{progress.time_s}\n")
        time.sleep(pause)
        return True

    run_module.drive(run, report, folder / "checkpoint", checkpoint_seconds=0.0)
    result = finished(run)
    text = json.dumps([[dataclasses.asdict(result.case)["duration"], result.ended], result.history])
    np.savez(
        folder / "result.part.npz",
        positions=result.positions,
        velocities=result.velocities,
        spins=result.spins,
        numbers=result.numbers,
        walls=run.simulation.walls.pose,
        text=np.frombuffer(text.encode(), np.uint8),
        **{f"left_{name}": value for name, value in result.departures._asdict().items()},
    )
    (folder / "result.part.npz").rename(folder / "result.npz")


if __name__ == "__main__":
    main(Path(sys.argv[1]), float(sys.argv[2]))

"""`make load [FOR=60]`: 10,000 jobs stored, two workers that simulate, 50 requests a second by locust on loopback.

Prints p50, p99 and errors, and how the memory of each process grew; FOR=3600 is the hour of mixed work: reads,
studies that are asked for, computed and finished.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from tests.builders.studies import a_study, add_finished_designs
from tests.faults.ledger import VARIANTS, Accepted
from tests.faults.rig import Rig, running_rig
from tests.load.memory import MemoryWatch

STUDIES, DESIGNS = 10, 1000
USERS, SPAWNED_PER_S = 25, 5
ROOT = Path(__file__).resolve().parents[2]


def keep_busy(rig: Rig, stop: threading.Event) -> None:
    """Four studies under way at any time."""
    count = 0
    while not stop.is_set():
        Accepted().send(rig, f"load-{time.time_ns()}-{count}", VARIANTS[count % len(VARIANTS)])
        count += 1
        stop.wait(0.0 if count < 4 else 4.0)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--backend", choices=("sqlite", "postgresql"), default="sqlite")
    wanted = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, running_rig(wanted.backend, lease_s=10.0) as rig:
        for _ in range(STUDIES):
            # Enough designs to be at their budget: they are stored and ask for no work.
            add_finished_designs(rig.database, a_study(rig.database, budget=DESIGNS), DESIGNS)
        stop = threading.Event()
        busy = threading.Thread(target=keep_busy, args=(rig, stop))
        busy.start()
        memory = MemoryWatch(rig.processes, every_s=max(2.0, wanted.seconds / 120))
        memory.start()
        command = [
            *(sys.executable, "-m", "locust", "--headless", "--only-summary"),
            *("--locustfile", str(Path(__file__).with_name("locustfile.py"))),
            *("--host", rig.settings.base_url, "--users", str(USERS), "--spawn-rate", str(SPAWNED_PER_S)),
            *("--run-time", f"{wanted.seconds}s", "--csv", f"{name}/load"),
        ]
        done = subprocess.run(command, cwd=ROOT, check=False)
        memory.stop()
        stop.set()
        busy.join()
        with Path(f"{name}/load_stats.csv").open(encoding="utf-8") as file:
            total = next(row for row in csv.DictReader(file) if row["Name"] == "Aggregated")
    print(
        f"{STUDIES * DESIGNS} jobs stored, {total['Request Count']} requests at "
        f"{float(total['Requests/s']):.0f}/s: p50 {total['50%']} ms, p99 {total['99%']} ms, "
        f"errors {total['Failure Count']}"
    )
    for process, growth in memory.growth.items():
        print(growth.line(process))
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())

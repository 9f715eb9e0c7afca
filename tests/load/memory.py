"""How much memory the processes of an installation take while they are at work, and how much more with time."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from statistics import linear_regression

from tests.faults.rig import Process

# What is loaded at the first requests and jobs is no growth.
WARM_UP = 0.2
HOUR_S = 3600.0


def resident_mb(pid: int) -> float:
    """Of one process; 0 where it has ended."""
    with suppress(FileNotFoundError, ProcessLookupError, StopIteration):
        status = Path(f"/proc/{pid}/status").read_text()
        return float(next(line.split()[1] for line in status.splitlines() if line.startswith("VmRSS"))) / 1024
    return 0.0


@dataclass
class Growth:
    """One process' memory over time: (seconds, MB) with its children's."""

    samples: list[tuple[float, float]] = field(default_factory=list)

    def line(self, name: str) -> str:
        settled = self.samples[int(WARM_UP * len(self.samples)) :]
        first, last = self.samples[0][1], self.samples[-1][1]
        text = f"{name}: {first:.0f} -> {last:.0f} MB"
        if len(settled) < 3:
            return text
        slope, _ = linear_regression(*zip(*settled, strict=True))
        return f"{text}, {slope * HOUR_S:+.1f} MB an hour once warm (over {settled[-1][0] - settled[0][0]:.0f} s)"


class MemoryWatch(threading.Thread):
    """Samples until told to stop."""

    def __init__(self, processes: Mapping[str, Process], every_s: float) -> None:
        super().__init__(daemon=True)
        self._processes, self._every_s = processes, every_s
        self._stopped = threading.Event()
        self.growth = {name: Growth() for name in processes}

    def run(self) -> None:
        started = time.monotonic()
        while True:
            for name, process in self._processes.items():
                total = sum(map(resident_mb, (process.pid, *process.children())))
                self.growth[name].samples.append((time.monotonic() - started, total))
            if self._stopped.wait(self._every_s):
                return

    def stop(self) -> None:
        self._stopped.set()
        self.join()

"""What an attempt costs."""

from __future__ import annotations

import resource
import time
from collections.abc import Mapping
from typing import Any

from service.code_version import demcore_hash
from service.domain.outcome import RunCost


class Stopwatch:
    """Wall and processor time from its making, and the process's peak memory."""

    def __init__(self) -> None:
        self._wall, self._cpu = time.monotonic(), time.process_time()

    def cost(self, results: Mapping[str, Any] | None = None) -> RunCost:
        """What was used until now; the time step and the number of steps where the results tell them."""
        results = results or {}
        steps, time_step = results.get("steps"), results.get("time_step_s")
        return RunCost(
            code_version=demcore_hash()[:16],
            time_step_s=float(time_step) if time_step is not None else None,
            steps=int(steps) if steps is not None else None,
            wall_s=time.monotonic() - self._wall,
            cpu_s=time.process_time() - self._cpu,
            # Linux counts in KiB.
            memory_mb=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
        )

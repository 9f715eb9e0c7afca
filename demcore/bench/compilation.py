"""How long the first call takes where nothing is compiled yet, and where everything is in the cache."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile

from demcore.errors import SimulationError

# Far above the mark of issue 3 (60 s), so that a slow machine still answers.
LONGEST_S = 600.0


class BenchFailed(SimulationError):
    """The bench in a process of its own did not answer."""

    kind = "bench"


def first_calls(law: str, threads: int) -> tuple[float, float]:
    """Seconds of the first step of the cylinder bed in two new processes, one after the other: the first with an
    empty cache, which it leaves to the second."""
    with tempfile.TemporaryDirectory(prefix="demcore-cache-") as cache:
        return _first_call(law, threads, cache), _first_call(law, threads, cache)


def _first_call(law: str, threads: int, cache: str) -> float:
    work = ["--bed", "cylinder", "--law", law, "--threads", str(threads)]
    command = [
        sys.executable,
        "-m",
        "demcore",
        "bench",
        *work,
        "--repeats",
        "1",
        "--particle-steps",
        "1",
        "--json",
    ]
    try:
        done = subprocess.run(
            command,
            env=os.environ | {"NUMBA_CACHE_DIR": cache},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=LONGEST_S,
            check=False,
        )
    except subprocess.TimeoutExpired as late:
        raise BenchFailed(f"no answer within {LONGEST_S:g} s") from late
    if done.returncode != 0:
        raise BenchFailed((done.stderr.strip().splitlines() or ["no answer"])[-1])
    return float(json.loads(done.stdout)[0]["first_call_s"])

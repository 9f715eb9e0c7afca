"""A real process, killed with SIGKILL in the middle: the next one ends with the same bits."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

PROGRAM = Path(__file__).with_name("killed_program.py")
ROOT = Path(__file__).parents[2]


def start(folder: Path, pause: float) -> subprocess.Popen[bytes]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        [sys.executable, str(PROGRAM), str(folder), str(pause)], env=environment, cwd=ROOT
    )


def times(folder: Path, process: subprocess.Popen[bytes]) -> list[float]:
    """Simulated times that a process has reported."""
    found = folder / f"times-{process.pid}"
    return [float(line) for line in found.read_text().splitlines()] if found.exists() else []


def kill_after(folder: Path, process: subprocess.Popen[bytes], reports: int) -> float:
    """SIGKILL after that many reports; the simulated time that it had reached."""
    deadline = time.monotonic() + 200.0
    while len(times(folder, process)) < reports:
        assert process.poll() is None, "it ended before it was killed"
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    assert process.wait(timeout=20) == -signal.SIGKILL
    return times(folder, process)[-1]


def test_killed_twice_and_resumed_is_the_run_that_was_never_killed(tmp_path):
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert start(whole, 0.0).wait(timeout=200) == 0
    reached = 0.0
    for _ in range(2):
        # Slowed down, so that it dies after some checkpoints, and at no chosen moment.
        process = start(killed, 0.02)
        latest = kill_after(killed, process, 12)
        assert not (killed / "result.npz").exists()
        assert times(killed, process)[0] > 0.5 * reached, "it went on, it did not start anew"
        assert latest > reached
        reached = latest
    last = start(killed, 0.0)
    assert last.wait(timeout=200) == 0
    assert times(killed, last)[0] > 0.5 * reached
    assert (killed / "result.npz").read_bytes() == (whole / "result.npz").read_bytes()

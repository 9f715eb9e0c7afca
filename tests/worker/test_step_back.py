"""Workers compute in what requests leave of the cores: their niceness, and that of their session's group."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from worker.process import AUTOGROUP

# In a session of its own, as the supervisor starts a worker; twice, because it may be that nice already.
PROGRAM = """
import os, sys
from pathlib import Path
from worker.process import AUTOGROUP, step_back
step_back(int(sys.argv[1]))
step_back(int(sys.argv[1]))
group = AUTOGROUP.read_text().split()[-1] if AUTOGROUP.exists() else sys.argv[1]
print(os.nice(0), group)
"""


@pytest.mark.parametrize("niceness", ["0", "7"])
def test_a_worker_steps_back_by_what_is_set(niceness: str) -> None:
    """It never steps forward: under a niceness of its own it keeps that."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, niceness],
        capture_output=True,
        text=True,
        check=True,
        start_new_session=True,
        cwd=Path(__file__).resolve().parents[2],
    )
    own, group = map(int, done.stdout.split())
    assert own >= int(niceness)
    assert group == int(niceness) or not AUTOGROUP.exists()

"""One process of the service that is kept alive: its log, its deaths, its end."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from service.processes import ProcessSpec, environment
from service.settings import Settings

# A process that lived this long was well: its next restart is immediate again.
SETTLED_SECONDS = 30.0
FIRST_DELAY_SECONDS = 0.5
LONGEST_DELAY_SECONDS = 30.0
LOG_ROTATE_BYTES = 10_000_000

Say = Callable[[str], None]


def restart_delay(early_deaths: int) -> float:
    """Seconds to wait before the next start after that many deaths in a row soon after a start."""
    return float(min(LONGEST_DELAY_SECONDS, FIRST_DELAY_SECONDS * 2 ** min(early_deaths, 10)))


def _die_with_parent() -> None:
    """In the child, on Linux: SIGTERM to it when the supervisor itself is killed."""
    if sys.platform == "linux":
        pr_set_pdeathsig = 1
        ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGTERM)


class Child:
    """One process that is kept alive, with its log."""

    def __init__(self, spec: ProcessSpec, settings: Settings) -> None:
        self.spec = spec
        self._settings = settings
        self._process: subprocess.Popen[bytes] | None = None
        self._started = 0.0
        self._next_start = 0.0
        self._early_deaths = 0

    @property
    def log(self) -> Path:
        return self._settings.logs_dir / f"{self.spec.name}.log"

    def start(self) -> None:
        if self.log.exists() and self.log.stat().st_size > LOG_ROTATE_BYTES:
            self.log.replace(self.log.with_suffix(".log.1"))
        with self.log.open("ab") as output:
            self._process = subprocess.Popen(
                self.spec.command,
                env=environment(self._settings, self.spec),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=_die_with_parent,  # noqa: PLW1509 - the supervisor has one thread
            )
        self._started = time.monotonic()

    def is_running(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def revive(self, say: Say) -> None:
        """Notices a death, and starts the process again when its delay is over."""
        if self.is_running():
            return
        now = time.monotonic()
        if self._process is not None:
            self._early_deaths = 0 if now - self._started > SETTLED_SECONDS else self._early_deaths + 1
            delay = restart_delay(self._early_deaths - 1) if self._early_deaths else 0.0
            say(
                f"{self.spec.name} ended ({_how(self._process.returncode)}), again in {delay:g} s; {self.log}"
            )
            self._end_group(signal.SIGKILL)
            self._process, self._next_start = None, now + delay
        if now >= self._next_start:
            self.start()

    def ask_to_stop(self) -> None:
        if self._process is not None and self.is_running():
            self._process.terminate()

    def kill(self) -> None:
        """Ends the process and all that it started, whatever state they are in."""
        if self._process is not None:
            self._end_group(signal.SIGKILL)
            self._process.wait()

    def _end_group(self, signal_number: signal.Signals) -> None:
        assert self._process is not None
        with suppress(ProcessLookupError):  # the whole group is gone already
            os.killpg(self._process.pid, signal_number)


def _how(return_code: int) -> str:
    return f"signal {signal.Signals(-return_code).name}" if return_code < 0 else f"exit {return_code}"


def end_all(children: Sequence[Child], seconds: float) -> None:
    """Asks all of them to end, and kills what has not within `seconds`."""
    for child in children:
        child.ask_to_stop()
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline and any(child.is_running() for child in children):
        time.sleep(0.02)
    for child in children:
        child.kill()


def last_line(log: Path) -> str:
    """The end of a log as one line, for a message."""
    lines = log.read_text(encoding="utf-8", errors="replace").split("\n") if log.exists() else []
    return next((line.strip() for line in reversed(lines) if line.strip()), "its log is empty")[:300]

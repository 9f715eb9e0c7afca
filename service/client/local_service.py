"""A service on this machine for as long as a command needs it: one that runs, or a new one."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from service.child_process import last_line
from service.client.rest import Client, ServiceAwayError
from service.installation_lock import check_port, find_running
from service.settings import Settings, StartupError

# The workers compile the kernels at their first start: 60 to 90 s on two idle cores, five minutes on busy ones.
START_SECONDS = 900.0
STOP_SECONDS = 12.0


@dataclass(frozen=True)
class LocalService:
    """A service that runs here; `process` is its supervisor where this process started it."""

    url: str
    log: Path
    process: subprocess.Popen[bytes] | None = None

    def wait_for(self, *checks: str) -> None:
        """Until these readiness checks hold. StartupError with the reason where that does not come."""
        deadline = time.monotonic() + START_SECONDS
        reason = "it does not answer"
        with Client(self.url) as client:
            while time.monotonic() < deadline:
                if self.process is not None and self.process.poll() is not None:
                    raise StartupError(last_line(self.log).removeprefix("talus: "))
                try:
                    found = client.readiness()["checks"]
                except ServiceAwayError:
                    found = None  # it is still starting
                if found is not None:
                    missing = [
                        found[name]["reason"] for name in checks if name in found and not found[name]["ok"]
                    ]
                    if not missing:
                        return
                    reason = "; ".join(missing)
                time.sleep(0.2)
        raise StartupError(f"the service at {self.url} was not ready within {START_SECONDS:g} s: {reason}")

    def stop(self) -> None:
        """Ends the supervisor if it is ours, which ends everything else."""
        if self.process is not None and self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(STOP_SECONDS)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()


@contextmanager
def running_service(settings: Settings) -> Iterator[LocalService]:
    """A service whose API answers; one that was started here ends with the block. Raises StartupError."""
    log = settings.logs_dir / "supervisor.log"
    found = find_running(settings)
    service = LocalService(found.url, log) if found is not None else _start(settings, log)
    try:
        service.wait_for("database", "schema")
        yield service
    finally:
        service.stop()


def _start(settings: Settings, log: Path) -> LocalService:
    # Otherwise another folder's service there answers before ours has found its port taken, and gets the work.
    try:
        check_port(settings)
    except StartupError as error:
        raise StartupError(
            f"no service runs on {settings.data_dir}, and {error}, or set TALUS_DATA_DIR to the folder of the "
            "service that is there"
        ) from None
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open("ab") as output:
        # A session of its own: Ctrl-C is for this process, which then ends the service in order.
        process = subprocess.Popen(
            [sys.executable, "-m", "service.cli", "serve"],
            env={
                **os.environ,
                "TALUS_DATA_DIR": str(settings.data_dir),
                "TALUS_WORKERS": str(settings.workers),
                "TALUS_THREADS": str(settings.threads),
            },
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    return LocalService(settings.base_url, log, process)

"""A whole installation as processes of its own, each of which can be killed, frozen and started again.

The commands are `service.processes`', as under the supervisor and in compose.yaml. Broker and PostgreSQL are
reached through proxies that can become black holes; the first worker's clock can be moved by libfaketime; the
data folder lies on a small tmpfs where this user may mount one.
"""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path

import httpx

from service import broker, processes
from service.db.migrate import upgrade
from service.db.session import Database
from service.processes import ProcessSpec
from service.settings import Settings
from tests.builders.postgres import SURVIVES_A_KILL, Postgres, running_postgres
from tests.faults.proxy import BlackHole

ROOT = Path(__file__).resolve().parents[2]
# Kernels may have to be compiled, and every core may be busy.
START_SECONDS = 300.0
# Often enough to lose no time, seldom enough to take none from the workers.
POLL_S = 0.25
DISK_BYTES = 192 * 2**20
POSTGRES_SOCKET = ".s.PGSQL.5432"
CLOCK_WORKER = "worker-1"
# Alembic keeps the migration that runs in a variable of the process; two rigs may start at once.
MIGRATING = threading.Lock()


def faketime_library() -> Path | None:
    """libfaketime from the PyPI package, else Debian's; None where neither is there."""
    found = find_spec("libfaketime")
    places = [Path("/usr/lib/x86_64-linux-gnu/faketime"), Path("/usr/lib/aarch64-linux-gnu/faketime")]
    if found is not None and found.origin is not None:
        places.insert(0, Path(found.origin).parent / "vendor" / "libfaketime" / "src")
    return next((file for place in places for file in sorted(place.glob("libfaketime.so*"))), None)


class Process:
    """One process of the installation: killed by its session, with all that it started, or alone."""

    def __init__(self, spec: ProcessSpec, settings: Settings, logs: Path, extra: dict[str, str]) -> None:
        self.spec, self._settings, self._extra = spec, settings, extra
        self.log = logs / f"{spec.name}.log"
        self._popen: subprocess.Popen[bytes] | None = None

    @property
    def pid(self) -> int:
        assert self._popen is not None
        return self._popen.pid

    def start(self) -> None:
        """Nothing where it runs: two faults that end both start it, and the first one's process would be forgotten
        and outlive the rig."""
        if self.is_running():
            return
        shared = processes.environment(self._settings, self.spec)
        with self.log.open("ab") as output:
            self._popen = subprocess.Popen(
                self.spec.command,
                cwd=ROOT,
                env={**shared, **self._extra},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                start_new_session=True,
            )

    def is_running(self) -> bool:
        return self._popen is not None and self._popen.poll() is None

    def kill(self, alone: bool = False) -> None:
        """kill -9 of it and its children, as when its machine dies; `alone` leaves the children."""
        if self._popen is not None:
            with suppress(ProcessLookupError):
                if alone:
                    os.kill(self.pid, signal.SIGKILL)
                else:
                    os.killpg(self.pid, signal.SIGKILL)
            self._popen.wait()

    def children(self) -> list[int]:
        with suppress(FileNotFoundError, ProcessLookupError):
            return [
                int(pid) for pid in Path(f"/proc/{self.pid}/task/{self.pid}/children").read_text().split()
            ]
        return []

    def last_words(self) -> str:
        text = self.log.read_text(errors="replace") if self.log.exists() else ""
        return f"{self.spec.name}:\n" + "\n".join(text.splitlines()[-12:])


class Rig:
    """The installation. `processes` by name: broker, api, dispatcher, worker-1, worker-2."""

    def __init__(
        self, folder: Path, settings: Settings, server: Postgres | None, has_small_disk: bool
    ) -> None:
        self.folder, self.data, self.settings, self.postgres = folder, settings.data_dir, settings, server
        self.has_small_disk = has_small_disk
        self.database = Database(self._direct_url())
        self._clock = folder / "clock"
        library = faketime_library()
        moved = (
            {
                "LD_PRELOAD": str(library),
                "FAKETIME_TIMESTAMP_FILE": str(self._clock),
                "FAKETIME_NO_CACHE": "1",
                "FAKETIME_DONT_FAKE_MONOTONIC": "1",
            }
            if library is not None
            else {}
        )
        self.can_move_clock = library is not None
        self.set_clock("+0")
        specs = (processes.broker_process(self._own_broker()), *processes.long_running(settings))
        self.processes = {
            spec.name: Process(spec, settings, folder, moved if spec.name == CLOCK_WORKER else {})
            for spec in specs
        }
        target = self._own_broker().broker_socket
        self.proxies = {"broker": BlackHole(folder / "broker.sock", target)}
        if server is not None:
            (folder / "pg").mkdir()
            self.proxies["postgresql"] = BlackHole(
                folder / "pg" / POSTGRES_SOCKET, server.folder / POSTGRES_SOCKET
            )

    @property
    def backend(self) -> str:
        return "sqlite" if self.postgres is None else "postgresql"

    @property
    def broker_socket(self) -> Path:
        """The real one, beside the proxy."""
        return self._own_broker().broker_socket

    def _own_broker(self) -> Settings:
        return self.settings.model_copy(update={"broker_url": None})

    def _direct_url(self) -> str:
        """The database past the proxy, for whoever looks from outside."""
        return self.settings.resolved_database_url if self.postgres is None else self.postgres.url()

    def workers(self) -> list[Process]:
        return [process for name, process in self.processes.items() if name.startswith("worker")]

    def set_clock(self, offset: str) -> None:
        self._clock.write_text(offset + "\n")

    def start(self) -> None:
        broker.prepare_folders(self._own_broker())
        with MIGRATING:
            upgrade(self._direct_url())
        for process in self.processes.values():
            process.start()
        self.wait_until_well()

    def heal(self) -> None:
        """Every fault is over: everything runs and is connected, clocks are right, the disk has room."""
        for proxy in self.proxies.values():
            proxy.heal()
        self.set_clock("+0")
        self.ballast.unlink(missing_ok=True)
        for process in self.processes.values():
            if not process.is_running():
                process.start()

    @property
    def ballast(self) -> Path:
        return self.data / "ballast"

    def wait_until_well(self) -> None:
        self.wait_for(self._is_well, START_SECONDS, "an installation that is well")

    def _is_well(self) -> bool:
        dead = [process for process in self.processes.values() if not process.is_running()]
        if dead:
            raise AssertionError("ended by itself: " + dead[0].last_words())
        try:
            checks = httpx.get(f"{self.settings.base_url}/v1/health/ready", timeout=5.0).json()["checks"]
        except (httpx.TransportError, ValueError):
            return False
        return all(check["ok"] for check in checks.values())

    def wait_for(self, is_so: Callable[[], bool], seconds: float, what: str) -> None:
        deadline = time.monotonic() + seconds
        while not is_so():
            if time.monotonic() > deadline:
                words = "\n".join(process.last_words() for process in self.processes.values())
                raise AssertionError(f"{what}: not within {seconds:g} s\n{words}")
            time.sleep(POLL_S)

    def close(self) -> None:
        for process in self.processes.values():
            process.kill()
        self.database.dispose()


@contextmanager
def small_disk() -> Iterator[tuple[Path, bool]]:
    """A folder on a tmpfs of its own, and True; a plain folder and False where mounting is not allowed."""
    with tempfile.TemporaryDirectory(prefix="talus-disk-") as name:
        options = f"size={DISK_BYTES},mode=0777"
        command = ["mount", "-t", "tmpfs", "-o", options, "talus-faults", name]
        try:
            is_mounted = subprocess.run(command, capture_output=True, check=False).returncode == 0
        except FileNotFoundError:
            is_mounted = False
        try:
            yield Path(name), is_mounted
        finally:
            if is_mounted:
                subprocess.run(["umount", "--lazy", name], check=True)


@contextmanager
def running_rig(backend: str, lease_s: float = 3.0, checkpoint_s: float = 0.25) -> Iterator[Rig]:
    """An installation that is well, on `backend` (sqlite or postgresql), with two workers and a true broker."""
    with ExitStack() as stack:
        folder = Path(tempfile.mkdtemp(prefix="talus-faults-"))
        stack.callback(shutil.rmtree, folder, ignore_errors=True)
        data, is_small = stack.enter_context(small_disk())
        server = stack.enter_context(running_postgres(SURVIVES_A_KILL)) if backend == "postgresql" else None
        url = None if server is None else f"postgresql://talus@/postgres?host={folder / 'pg'}"
        settings = Settings(
            data_dir=data,
            database_url=url,
            broker_url=f"redis+socket://{folder / 'broker.sock'}",
            port=free_port(),
            lease_seconds=lease_s,
            checkpoint_seconds=checkpoint_s,
            disk_pause_seconds=2.0,
            workers=2,
        )
        rig = Rig(folder, settings, server, is_small)
        stack.callback(rig.close)
        for proxy in rig.proxies.values():
            stack.enter_context(proxy)
        rig.start()
        yield rig


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])

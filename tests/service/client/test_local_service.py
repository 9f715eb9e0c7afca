"""The service that a command uses: the one that runs on its data folder, never another one."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from service.client.local_service import running_service
from service.settings import Settings, StartupError


def test_a_taken_port_is_told_before_anything_is_asked_of_who_listens_there(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        settings = Settings(data_dir=tmp_path, port=port)
        with (
            pytest.raises(
                StartupError, match=rf"no service runs on .*port {port} .*TALUS_PORT.*TALUS_DATA_DIR"
            ),
            running_service(settings),
        ):
            pass
        other.settimeout(0.0)
        with pytest.raises(BlockingIOError):
            other.accept()  # nobody has called
    assert not (tmp_path / "logs").exists()

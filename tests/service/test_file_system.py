"""Where an SQLite database may lie."""

from __future__ import annotations

from pathlib import Path

import pytest

from service.db import file_system
from service.db.file_system import NetworkFileSystem, file_system_type, refuse_network_file_system
from service.db.session import make_engine

MOUNTS = """\
/dev/sda1 / ext4 rw 0 0
server:/export /home nfs4 rw 0 0
/dev/sdb1 /home/fast\\040disk xfs rw 0 0
"""


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("/var/talus.db", "ext4"),
        ("/home/ann/talus.db", "nfs4"),
        ("/home/fast disk/talus.db", "xfs"),
        ("/homestead/talus.db", "ext4"),
    ],
)
def test_the_innermost_mount_counts(path: str, kind: str) -> None:
    assert file_system_type(Path(path), MOUNTS) == kind


def test_a_network_file_system_is_refused_with_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refuse_network_file_system(tmp_path / "talus.db")
    monkeypatch.setattr(file_system, "file_system_type", lambda _path, _mounts: "nfs4")
    with pytest.raises(NetworkFileSystem, match="TALUS_DATA_DIR"):
        make_engine(f"sqlite:///{tmp_path / 'talus.db'}")


def test_a_database_in_memory_is_refused() -> None:
    with pytest.raises(ValueError, match="name a file"):
        make_engine("sqlite://")

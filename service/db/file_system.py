"""Where an SQLite file may lie: not on a network file system, whose locks do not keep writers apart."""

from __future__ import annotations

import re
from pathlib import Path

NETWORK_FILE_SYSTEMS = frozenset(
    {"nfs", "nfs4", "cifs", "smb3", "smbfs", "afs", "ceph", "9p", "fuse.sshfs", "fuse.glusterfs", "lustre"}
)


class NetworkFileSystem(RuntimeError):
    """The database file would lie on a file system whose locks cannot be trusted."""


def file_system_type(path: Path, mounts: str) -> str | None:
    """The type of the innermost mount that holds `path`, from the text of /proc/mounts. None: not found."""
    best: tuple[int, str] | None = None
    for line in mounts.splitlines():
        fields = line.split(" ")
        if len(fields) < 3:
            continue
        mount = Path(re.sub(r"\\([0-7]{3})", lambda octal: chr(int(octal[1], 8)), fields[1]))
        if path.is_relative_to(mount) and (best is None or len(mount.parts) >= best[0]):
            best = (len(mount.parts), fields[2])
    return best[1] if best else None


def refuse_network_file_system(path: Path) -> None:
    """Raise NetworkFileSystem when `path` lies on one. Says nothing where the system does not tell."""
    table = Path("/proc/mounts")
    if not table.exists():
        return
    kind = file_system_type(path.resolve(), table.read_text(encoding="utf-8", errors="replace"))
    if kind in NETWORK_FILE_SYSTEMS:
        raise NetworkFileSystem(
            f"the SQLite database {path} lies on {kind}, whose locks cannot be trusted: "
            "put TALUS_DATA_DIR on a local disk, or set TALUS_DATABASE_URL to a PostgreSQL database"
        )

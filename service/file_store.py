"""Where the files that rows name lie: below the data folder, or in an object store that several machines reach.

Every file is stored whole before a row names it, under a name made of its content, and never changes. So a reader
needs no lock, the same file may be stored twice, and a copy on this machine is never out of date.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from pkgutil import resolve_name
from typing import IO, TYPE_CHECKING, Any, Protocol

from service.settings import Settings, StartupError

if TYPE_CHECKING:
    from fsspec import AbstractFileSystem

# Two processes on one machine may store or fetch the same file at once: each writes aside, under its own name.
ASIDE = ".incoming-"
# Errors of S3's, Google's and Azure's clients that are no OSError. None of these packages need be installed.
FAULTS = (
    "botocore.exceptions:BotoCoreError",
    "botocore.exceptions:ClientError",
    "aiohttp:ClientError",
    "gcsfs.retry:HttpError",
    "google.auth.exceptions:GoogleAuthError",
    "azure.core.exceptions:AzureError",
)


class StoreAway(OSError):
    """The object store cannot be reached, or refuses; nothing was stored."""


@dataclass(frozen=True)
class StoredFile:
    """A file of a store; `modified` is in seconds since 1970."""

    name: str
    size_bytes: int
    modified: float


class FileStore(Protocol):
    """Files by name, with `/` between the parts of a name. Every method may raise StoreAway."""

    def incoming(self) -> AbstractContextManager[Path]:
        """An empty folder to write into what is put next; it goes, with what is left in it."""

    def put(self, file: Path, name: str) -> None:
        """Move `file` into the store: it is there whole when this returns, after a power cut too, or not."""

    def open(self, name: str) -> IO[bytes]:
        """Raises FileNotFoundError."""

    def local(self, name: str) -> Path:
        """The file on this machine, to be read only; a path without a file where the store has none."""

    def files(self) -> Iterator[StoredFile]:
        """Everything in it by name, with what is being written, or was when a process was killed."""

    def remove(self, name: str) -> None:
        """It may be gone already."""

    def size(self, name: str) -> int | None:
        """In bytes; None where there is no such file."""

    def place(self, name: str) -> str:
        """What a person is told of where it lies."""


@dataclass(frozen=True)
class FolderStore:
    """Files below a folder."""

    folder: Path

    @contextmanager
    def incoming(self) -> Iterator[Path]:
        self.folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=ASIDE, dir=self.folder) as name:
            yield Path(name)

    def put(self, file: Path, name: str) -> None:
        target = self.folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        with file.open("rb") as stream:
            os.fsync(stream.fileno())
        os.replace(file, target)
        _sync_folder(target.parent)

    def open(self, name: str) -> IO[bytes]:
        return (self.folder / name).open("rb")

    def local(self, name: str) -> Path:
        return self.folder / name

    def files(self) -> Iterator[StoredFile]:
        for path in sorted(self.folder.rglob("*")) if self.folder.is_dir() else ():
            name = path.relative_to(self.folder).as_posix()
            if path.is_file():
                state = path.stat()
                yield StoredFile(name, state.st_size, state.st_mtime)

    def remove(self, name: str) -> None:
        (self.folder / name).unlink(missing_ok=True)

    def size(self, name: str) -> int | None:
        path = self.folder / name
        return path.stat().st_size if path.is_file() else None

    def place(self, name: str) -> str:
        return str(self.folder / name)


@dataclass(frozen=True)
class ObjectStore:
    """Files below `root` of a file system of fsspec; what must be a file here is copied into `copies`, once."""

    file_system: AbstractFileSystem
    root: str
    copies: Path

    @contextmanager
    def incoming(self) -> Iterator[Path]:
        with tempfile.TemporaryDirectory(prefix="talus-incoming-") as name:
            yield Path(name)

    def put(self, file: Path, name: str) -> None:
        # One request puts an object whole or not at all; the same content needs no second transfer.
        if self.size(name) != file.stat().st_size:
            try:
                with _reached(self.root):
                    self.file_system.put_file(str(file), self._path(name))
            except (
                FileNotFoundError
            ) as error:  # the bucket: it is the owner's to make, with the rights it needs
                raise StoreAway(f"{self.place(name)} cannot be put: {error}") from error
        file.unlink()

    def open(self, name: str) -> IO[bytes]:
        with _reached(self.root):
            found: IO[bytes] = self.file_system.open(self._path(name), "rb")
            return found

    def local(self, name: str) -> Path:
        target = self.copies / name
        if target.is_file():
            return target
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=ASIDE, dir=self.copies) as folder:
            aside = Path(folder) / target.name
            try:
                with self.open(name) as source, aside.open("wb") as copy, _reached(self.root):
                    shutil.copyfileobj(source, copy)
            except FileNotFoundError:
                return target
            os.replace(aside, target)
        return target

    def files(self) -> Iterator[StoredFile]:
        with _reached(self.root):
            found: dict[str, dict[str, Any]] = self.file_system.find(self.root, detail=True)
        for path, state in sorted(found.items()):
            name = path.removeprefix(self.root).lstrip("/")
            with _reached(self.root):
                modified = self.file_system.modified(path).timestamp()
            yield StoredFile(name, int(state["size"]), modified)

    def remove(self, name: str) -> None:
        with _reached(self.root):
            if self.file_system.exists(self._path(name)):
                self.file_system.rm_file(self._path(name))
        (self.copies / name).unlink(missing_ok=True)

    def size(self, name: str) -> int | None:
        with _reached(self.root):
            try:
                return int(self.file_system.size(self._path(name)))
            except FileNotFoundError:
                return None

    def place(self, name: str) -> str:
        found: str = self.file_system.unstrip_protocol(self._path(name))
        return found

    def _path(self, name: str) -> str:
        return f"{self.root}/{name}"


def artifact_store(settings: Settings) -> FileStore:
    """What runs leave: <sha256[:2]>/<sha256>."""
    return _store(settings.store_url, settings.artifacts_dir)


def geometry_store(settings: Settings) -> FileStore:
    """Uploaded meshes: <sha256>.<suffix>."""
    return _store(settings.store_url, settings.geometries_dir)


def _store(url: str | None, folder: Path) -> FileStore:
    if url is None:
        return FolderStore(folder)
    file_system, root = _connected(url)
    return ObjectStore(file_system, f"{root.rstrip('/')}/{folder.name}", folder)


@lru_cache(maxsize=4)
def _connected(url: str) -> tuple[AbstractFileSystem, str]:
    """The file system and the path on it. Its own settings (keys, endpoint) come from its usual variables."""
    from fsspec.core import url_to_fs

    try:
        # A kept listing would hide what another machine stored.
        found: tuple[AbstractFileSystem, str] = url_to_fs(url, use_listings_cache=False)
    except ImportError as error:
        protocol = url.partition("://")[0]
        raise StartupError(
            f"TALUS_STORE_URL={protocol}://... needs a package that is not installed: {error}"
        ) from error
    except ValueError as error:
        raise StartupError(f"TALUS_STORE_URL: {error}") from error
    return found


@contextmanager
def _reached(root: str) -> Iterator[None]:
    """Whatever else than "no such file" goes wrong on the way is StoreAway."""
    try:
        yield
    except (FileNotFoundError, StoreAway):
        raise
    except _faults() as error:
        raise StoreAway(f"{root} cannot be used ({type(error).__name__}: {error})") from error


def _faults() -> tuple[type[Exception], ...]:
    """What the loaded file systems raise when their store is away or refuses: OSError, and errors of their own."""
    own = [resolve_name(name) for name in FAULTS if name.partition(":")[0] in sys.modules]
    return (OSError, *own)


def _sync_folder(folder: Path) -> None:
    # A rename survives a power cut only when its folder is written too.
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)

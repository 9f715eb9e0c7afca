"""HDF5 files on a disk that may be full.

HDF5 must not learn that a write failed: afterwards its cache is in a state that it refuses ("slist already
enabled?"), objects that are let go raise where nobody can catch them, and the process may end by a segmentation
fault (seen with HDF5 2.0 at every amount of room). So it writes through a file object that keeps what the disk
did not take, and the error of the disk is raised here when HDF5 has finished.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py


class PatientFile(io.RawIOBase):
    """A file on the disk whose writes never fail. `error` is the first that the disk refused, None before it.

    From then on what is written is kept in memory, where it can be read back; the file is lost, and its user is
    expected to stop soon.
    """

    def __init__(self, path: Path, new: bool) -> None:
        flags = os.O_RDWR | os.O_CREAT | os.O_TRUNC if new else os.O_RDWR
        self._handle = os.open(path, flags, 0o666)
        self._place = 0
        self._kept = list[tuple[int, bytes]]()
        self.error: OSError | None = None

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        start = {os.SEEK_SET: 0, os.SEEK_CUR: self._place, os.SEEK_END: self._length()}[whence]
        self._place = start + offset
        return self._place

    def tell(self) -> int:
        return self._place

    def readinto(self, buffer: bytearray | memoryview) -> int:  # type: ignore[override]
        wanted = memoryview(buffer).cast("B")
        first, count = self._place, max(0, min(len(wanted), self._length() - self._place))
        have = os.pread(self._handle, count, first)
        wanted[:count] = have.ljust(count, b"\0")
        for place, piece in self._kept:
            low, high = max(place, first), min(place + len(piece), first + count)
            if low < high:
                wanted[low - first : high - first] = piece[low - place : high - place]
        self._place += count
        return count

    def write(self, data: bytes | bytearray | memoryview) -> int:  # type: ignore[override]
        piece, done = bytes(data), 0
        try:
            while self.error is None and done < len(piece):
                done += os.pwrite(self._handle, piece[done:], self._place + done)
        except OSError as error:
            self.error = error
        if done < len(piece):
            self._kept.append((self._place + done, piece[done:]))
        self._place += len(piece)
        return len(piece)

    def truncate(self, size: int | None = None) -> int:
        size = self._place if size is None else size
        try:
            os.ftruncate(self._handle, size)
        except OSError as error:
            self.error = self.error or error
        return size

    def close(self) -> None:
        if not self.closed:
            os.close(self._handle)
        super().close()

    def check(self) -> None:
        """Raise what the disk refused."""
        if self.error is not None:
            raise self.error

    def _length(self) -> int:
        return max([os.fstat(self._handle).st_size, *(place + len(piece) for place, piece in self._kept)])


class HdfWriter:
    """An HDF5 file open for writing (`root`); not locked, so that others may read it while it grows.

    Raises OSError, with the disk's errno, from `flush` and `close` when the disk refused something since.
    """

    def __init__(self, path: Path, new: bool = True) -> None:
        self._disk = PatientFile(path, new)
        self.root = h5py.File(self._disk, "w" if new else "r+")

    def flush(self) -> None:
        self.root.flush()
        self._disk.check()

    def close(self) -> None:
        """Close it; a second time does nothing."""
        if not self._disk.closed:
            self.root.close()
            self._disk.close()
            self._disk.check()


@contextmanager
def written(path: Path, new: bool = True) -> Iterator[h5py.File]:
    """A file to write in one go: a new one, or one that is there."""
    writer = HdfWriter(path, new)
    try:
        yield writer.root
    finally:
        writer.close()

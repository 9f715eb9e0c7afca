"""The frames of a run as they come, in one file that a kill cannot spoil: an append-only journal.

HDF5 files that grow are not whole while they are being written to. So frames go here first; a run that resumes
cuts off what is torn or will come again, and makes its files for ParaView anew from the rest.

A record: length of the content (8 bytes, little endian), its sha256 (32 bytes), the content (.npz).
"""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]

HEAD = 40
TIME = "time"


class FrameJournal:
    """Frames in order of time, each a set of arrays by name; `time` is reserved."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def append(self, time: float, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Add a frame; on return it is on the disk."""
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **{TIME: np.array(time), **arrays})
        content = buffer.getvalue()
        with open(self.path, "ab") as file:
            file.write(len(content).to_bytes(8, "little") + hashlib.sha256(content).digest() + content)
            file.flush()
            os.fsync(file.fileno())

    def frames(self) -> Iterator[tuple[float, Arrays]]:
        """The whole frames, one in memory at a time; a torn one ends them."""
        for _, time, arrays in self._records():
            yield time, arrays

    def cut(self, time: float) -> None:
        """Forget the frames later than `time`, s, and what is torn."""
        keep = 0
        for end, at, _ in self._records():
            if at > time:
                break
            keep = end
        if self.path.exists():
            os.truncate(self.path, keep)

    def discard(self) -> None:
        self.path.unlink(missing_ok=True)

    def _records(self) -> Iterator[tuple[int, float, Arrays]]:
        if not self.path.exists():
            return
        with open(self.path, "rb") as file:
            while True:
                head = file.read(HEAD)
                length = int.from_bytes(head[:8], "little")
                content = file.read(length) if len(head) == HEAD else b""
                if len(head) < HEAD or hashlib.sha256(content).digest() != head[8:]:
                    return
                with np.load(io.BytesIO(content), allow_pickle=False) as stored:
                    arrays = {name: stored[name] for name in stored.files}
                yield file.tell(), float(arrays.pop(TIME)), arrays

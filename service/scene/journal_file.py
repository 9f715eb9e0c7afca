"""Reads the frames of a charge that is still simulated, from the journal that its run appends to.

demcore/output/frames.py says how it is written: a record is on the disk before the next one begins, and a torn one
can only be the last. So no lock is needed, and no copy: what is whole is shown.

Notation: record k is frame k of the run; units are SI.
"""

from __future__ import annotations

import hashlib
import io
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.output.frames import HEAD, TIME
from service.scene.sphere_file import Frames, Spheres, Surface, Unreadable

# As demcore's recorder calls it, which cannot be imported here: it loads the kernels.
JOURNAL = "series.journal"
POINT_DATA = ("Velocity", "AngularVelocity", "Material", "Number")
WALLS = "wall_points"
NO_WALLS = Surface(np.empty((0, 3)), np.empty((0, 3), np.int64), np.empty(0, np.int64))


class Record(NamedTuple):
    """A whole record: where its content begins, its head, its time, s, how many grains it has, whether the walls
    are in it."""

    start: int
    head: bytes
    time_s: float
    grains: int
    has_walls: bool


def list_journal(path: Path) -> Frames:
    """The whole frames so far. Raises Unreadable where there is no journal."""
    records = _records(path)
    return Frames(
        tuple(record.time_s for record in records),
        tuple(record.grains for record in records),
        frozenset((*POINT_DATA, "Radius")),
    )


def read_journal_spheres(path: Path, k: int) -> Spheres:
    """Frame `k`. Raises Unreadable, and IndexError where there is no such frame yet."""
    record = _record(_records(path), k)
    arrays = _arrays(path, record.start, record.head)
    data = {name: arrays[name] for name in POINT_DATA}
    return Spheres(
        record.time_s, np.asarray(arrays["Points"], float), np.asarray(arrays["Radius"], float), data
    )


def read_journal_surface(path: Path, k: int) -> Surface:
    """The walls of frame `k`: those that were written last, for walls that stand still are not written again."""
    records = _records(path)
    _record(records, k)
    known = [record for record in records[: k + 1] if record.has_walls]
    if not known:
        return NO_WALLS
    arrays = _arrays(path, known[-1].start, known[-1].head)
    triangles = np.asarray(arrays["wall_triangles"], np.int64)
    return Surface(np.asarray(arrays[WALLS], float), triangles, np.asarray(arrays["wall_number"], np.int64))


def _record(records: list[Record], k: int) -> Record:
    if not 0 <= k < len(records):
        raise IndexError(k)
    return records[k]


def _records(path: Path) -> list[Record]:
    found: list[Record] = []
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            start = HEAD
            while start <= size:
                head = file.read(HEAD)
                end = start + _length(head)
                if end > size:
                    break
                found.append(_described(path, start, head))
                file.seek(end)
                start = end + HEAD
    except OSError as error:
        raise Unreadable(f"the frames of the run cannot be read ({error.strerror})") from error
    return found


def _length(head: bytes) -> int:
    return int.from_bytes(head[:8], "little")


# By its head, which has the checksum: a run that begins anew with shorter steps writes other frames to its places.
@lru_cache(maxsize=4096)
def _described(path: Path, start: int, head: bytes) -> Record:
    arrays = _arrays(path, start, head)
    return Record(start, head, float(arrays[TIME]), len(arrays["Radius"]), WALLS in arrays)


def _arrays(path: Path, start: int, head: bytes) -> dict[str, NDArray[Any]]:
    """The content of a record. Raises Unreadable where it is not what its checksum says."""
    with path.open("rb") as file:
        file.seek(start)
        content = file.read(_length(head))
    if hashlib.sha256(content).digest() != head[8:]:
        raise Unreadable("the frames of the run are being written anew")
    with np.load(io.BytesIO(content), allow_pickle=False) as stored:
        return {name: stored[name] for name in stored.files}

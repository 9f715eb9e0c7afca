"""A disk that takes no more at any byte: the disk's own error and no half file, whatever HDF5 was doing then."""

from __future__ import annotations

import errno
import os

import h5py
import numpy as np
import pytest

from demcore.output.hdf_file import PatientFile
from demcore.output.result_file import Column, read_result, write_result
from demcore.output.spheres import write_spheres
from demcore.output.vtkhdf import PolyData, PolyDataSeries

ROWS = 400
POSITIONS = np.random.default_rng(1).random((ROWS, 3))
COLUMNS = {"p/position": Column(POSITIONS, "m", "centres"), "level": Column(np.arange(ROWS), "m", "a curve")}


def result(path):
    write_result(path, "pile", 1, {"scale": 2.0}, {"angle_deg": 25.0}, COLUMNS)


def result_with_spheres(path):
    write_result(path, "pile", 1, {"scale": 2.0}, {"angle_deg": 25.0}, COLUMNS, {"Points": "p/position"})


def spheres(path):
    write_spheres(path, POSITIONS, POSITIONS[:, 0], {}, {"angle_deg": 25.0})


def series(path):
    with PolyDataSeries(path, "Vertices", ()) as growing:
        for k in range(4):
            growing.append(float(k), PolyData(POSITIONS + k, np.arange(ROWS)[:, None], {}, {}))


class SmallDisk:
    """Takes `room` bytes, then what a full disk answers: a short write first, as POSIX has it, and ENOSPC."""

    def __init__(self, room, monkeypatch):
        self.room, self.taken, self._write = room, 0, os.pwrite
        monkeypatch.setattr(os, "pwrite", self)

    def __call__(self, handle, data, place):
        fits = min(len(data), self.room - self.taken)
        if data and fits == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.taken += fits
        return self._write(handle, data[:fits], place)


@pytest.mark.parametrize("write", [result, result_with_spheres, spheres, series])
def test_the_error_is_the_disks_at_every_amount_of_room(write, tmp_path, monkeypatch):
    roomy = SmallDisk(10**9, monkeypatch)
    write(tmp_path / "whole")
    wanted = roomy.taken
    monkeypatch.undo()
    assert wanted > 10_000
    # Every place where HDF5 writes something is met: it writes in a hundred pieces or fewer.
    for room in [*range(0, wanted, wanted // 150), wanted - 1]:
        with monkeypatch.context() as patch:
            SmallDisk(room, patch)
            with pytest.raises(OSError, match="No space left") as caught:
                write(tmp_path / "file")
            assert caught.value.errno == errno.ENOSPC
        # A series grows under its own name; what is written in one go appears whole or not at all.
        assert write is series or not (tmp_path / "file").exists()
    write(tmp_path / "file")
    assert (tmp_path / "file").read_bytes() == (tmp_path / "whole").read_bytes()


def test_what_the_disk_refused_can_be_read_back(tmp_path, monkeypatch):
    """HDF5 reads its own parts again; they must be what it wrote."""
    SmallDisk(3, monkeypatch)
    file = PatientFile(tmp_path / "file", new=True)
    file.write(b"abcdef")
    file.seek(4)
    file.write(b"XY")
    file.seek(-5, os.SEEK_END)
    assert (file.tell(), file.read(9)) == (1, b"bcdXY")
    assert file.error.errno == errno.ENOSPC
    file.close()
    assert (tmp_path / "file").read_bytes() == b"abc"


def test_a_result_is_read_by_hdf5_itself(tmp_path):
    result(tmp_path / "file")
    with h5py.File(tmp_path / "file", "r") as file:
        np.testing.assert_array_equal(file["p/position"], POSITIONS)
    assert read_result(tmp_path / "file").summary == {"angle_deg": 25.0}

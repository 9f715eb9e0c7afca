"""The result file: what was written is read back, described, the same bytes every time, or refused."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from demcore.errors import InputError
from demcore.output.result_file import Column, program_version, read_result, write_result

CASE = {"scale": 2.0, "sizes": [{"lower": 0.01}], "given": None}
SUMMARY = {"angle_deg": 25.5, "missing_deg": float("nan"), "count": np.int64(7)}
COLUMNS = {
    "particles/position": Column(np.arange(6.0).reshape(2, 3), "m", "centres"),
    "left/number": Column(np.zeros(0, np.int64), "1", "who left"),
}


def write(path):
    write_result(path, "pile", 3, CASE, SUMMARY, COLUMNS)
    return path


def test_what_was_written_is_read_back(tmp_path):
    stored = read_result(write(tmp_path / "result.h5"))
    assert (stored.kind, stored.seed, stored.version) == ("pile", 3, program_version())
    assert stored.case == CASE
    assert stored.summary == {"angle_deg": 25.5, "missing_deg": None, "count": 7}
    assert set(stored.columns) == set(COLUMNS)
    for name, column in COLUMNS.items():
        np.testing.assert_array_equal(stored.columns[name].values, column.values)
        assert stored.columns[name][1:] == column[1:]
    assert len(stored.source_sha256) == 64
    assert [path.name for path in tmp_path.iterdir()] == ["result.h5"]


def test_same_content_same_bytes(tmp_path):
    assert write(tmp_path / "a").read_bytes() == write(tmp_path / "b").read_bytes()


def test_every_array_says_its_unit_to_any_reader_of_hdf5(tmp_path):
    with h5py.File(write(tmp_path / "result.h5"), "r") as file:
        assert file["particles/position"].attrs["units"] == "m"
        assert file["particles/position"].attrs["meaning"] == "centres"


@pytest.mark.parametrize("size", [0, 8, 1000, -1])
def test_a_truncated_file_is_refused(size, tmp_path):
    path = write(tmp_path / "result.h5")
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(InputError, match=r"result\.h5"):
        read_result(path)


def test_another_hdf5_file_is_refused(tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["a"] = 1
    with pytest.raises(InputError, match="talus-result-1"):
        read_result(tmp_path / "other.h5")

"""Checkpoints: whole or refused, and what is refused is said."""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
import pytest

from demcore import checkpoint


def test_arrays_and_numbers_come_back_to_the_bit(tmp_path):
    path = tmp_path / "c"
    arrays = {"a": np.array([0.1, -0.0, np.pi]), "b": np.zeros((0, 3), np.int32), "c": np.array([True])}
    checkpoint.save(path, {"x": 0.1 + 0.2, "name": "ü"}, arrays)
    numbers, found = checkpoint.load(path)
    assert numbers == {"x": 0.1 + 0.2, "name": "ü"}
    assert set(found) == set(arrays)
    for name, value in arrays.items():
        assert found[name].tobytes() == value.tobytes()
        assert (found[name].dtype, found[name].shape) == (value.dtype, value.shape)


@pytest.mark.parametrize("cut", [0, 5, 30, 84, 100, -10, -1])
def test_a_truncated_file_is_refused_by_name_and_the_one_before_is_used(tmp_path, cut):
    path = tmp_path / "c"
    for value in (1.0, 2.0):
        checkpoint.save(path, {"value": value}, {"a": np.array([value])})
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(checkpoint.BadCheckpoint, match=r"c is .*truncated"):
        checkpoint.load(path)
    with pytest.warns(checkpoint.CheckpointWarning, match="refused: c is"):
        newest = checkpoint.load_newest(path)
    assert newest is not None
    assert newest[0]["value"] == 1.0
    assert newest[1]["a"][0] == 1.0


def test_one_flipped_bit_is_refused(tmp_path):
    path = tmp_path / "c"
    checkpoint.save(path, {}, {"a": np.arange(100.0)})
    raw = bytearray(path.read_bytes())
    raw[len(raw) // 2] ^= 1
    path.write_bytes(bytes(raw))
    with pytest.raises(checkpoint.BadCheckpoint, match="altered"):
        checkpoint.load(path)


def test_one_of_another_case_is_passed_over_and_said(tmp_path):
    path = tmp_path / "c"
    checkpoint.save(path, {"identity": "mine", "n": 1}, {})
    checkpoint.save(path, {"identity": "another's", "n": 2}, {})
    with pytest.warns(checkpoint.CheckpointWarning, match="c is of another case"):
        found = checkpoint.load_newest(path, "mine")
    assert found is not None
    assert found[0]["n"] == 1


def test_nothing_there_is_no_reason_for_a_warning(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert checkpoint.load_newest(tmp_path / "c") is None


def test_a_write_that_was_cut_off_leaves_the_last_file_as_it_was(tmp_path):
    path = tmp_path / "c"
    checkpoint.save(path, {"value": 1}, {})
    (tmp_path / "c.part").write_bytes(b"half of the next")
    assert checkpoint.load(path)[0]["value"] == 1
    checkpoint.discard(path)
    assert list(tmp_path.iterdir()) == []


class Inner(NamedTuple):
    a: np.ndarray


class Outer(NamedTuple):
    x: np.ndarray
    inner: Inner


def test_nested_records_are_flattened_and_rebuilt():
    record = Outer(np.arange(3), Inner(np.arange(2.0)))
    arrays = checkpoint.flat("r", record)
    assert set(arrays) == {"r_x", "r_inner_a"}
    again = checkpoint.rebuilt("r", Outer(np.zeros(0), Inner(np.zeros(0))), arrays)
    assert isinstance(again.inner, Inner)
    assert again.inner.a.tolist() == [0.0, 1.0]

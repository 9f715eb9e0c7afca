"""Stored grains are read back frame by frame, as demcore's own writer left them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from service.scene.sphere_file import Unreadable, list_frames, read_arrivals, read_spheres, read_surface
from tests.builders.scenes import a_pile_file, a_series_file, a_walls_file, block_of_grains


def test_a_pile_is_one_frame(tmp_path: Path) -> None:
    path = a_pile_file(tmp_path, 60)
    held = list_frames(path)
    assert (held.times_s, held.counts) == ((0.0,), (60,))
    assert "Number" not in held.fields and {"Velocity", "Material"} <= held.fields
    spheres = read_spheres(path, 0)
    positions, radii = block_of_grains(60)
    assert np.array_equal(spheres.positions, positions) and np.array_equal(spheres.radii, radii)
    assert spheres.speeds == pytest.approx(1e-3 * np.arange(60))


def test_a_series_has_its_own_grains_in_every_frame(tmp_path: Path) -> None:
    path = a_series_file(tmp_path, frames=4, count=12)
    assert list_frames(path).counts == (3, 6, 9, 12)
    assert list_frames(path).times_s == (0.0, 2.0, 4.0, 6.0)
    for k in range(4):
        spheres = read_spheres(path, k)
        assert spheres.time_s == 2.0 * k
        assert spheres.data["Number"].tolist() == list(range(100, 100 + 3 * (k + 1)))
        # Grain n came with frame n // 3 and has fallen by half a metre in each since.
        falls = 0.6 - 0.5 * (k - np.arange(3 * (k + 1)) // 3)
        assert spheres.positions[:, 2] == pytest.approx(falls, abs=1e-6)


def test_a_grain_arrives_in_the_first_frame_that_has_it_below_the_level(tmp_path: Path) -> None:
    arrivals = read_arrivals(a_series_file(tmp_path, frames=4, count=12), 0.0)
    # Those of frame 0 start at .6 m and are at -.4 m in frame 2, at 4 s; the next three a frame later.
    assert arrivals[100:106].tolist() == [4.0, 4.0, 4.0, 6.0, 6.0, 6.0]
    assert np.isnan(arrivals[106:]).all() and np.isnan(arrivals[:100]).all()


def test_arrivals_need_numbers(tmp_path: Path) -> None:
    with pytest.raises(Unreadable, match="does not number"):
        read_arrivals(a_pile_file(tmp_path), 0.0)


def test_walls_that_stand_still_are_the_same_in_every_frame(tmp_path: Path) -> None:
    path = a_walls_file(tmp_path, frames=3)
    first, last = read_surface(path, 0), read_surface(path, 2)
    assert np.array_equal(first.points, last.points) and np.array_equal(first.triangles, last.triangles)
    assert np.unique(first.walls).tolist() == [0, 1]
    corners = first.points[first.triangles[first.walls == 0]]
    assert np.hypot(corners[..., 0], corners[..., 1]) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("k", [-1, 1, 7])
def test_there_is_no_frame_beyond_the_last(k: int, tmp_path: Path) -> None:
    with pytest.raises(IndexError):
        read_spheres(a_pile_file(tmp_path), k)


@pytest.mark.parametrize("keep", [0, 100, 3000])
def test_a_damaged_file_is_said_to_be_one(keep: int, tmp_path: Path) -> None:
    path = a_pile_file(tmp_path)
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(Unreadable, match="cannot be read"):
        list_frames(path)


def test_another_hdf5_file_is_no_scene(tmp_path: Path) -> None:
    import h5py

    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = [1.0]
    with pytest.raises(Unreadable):
        list_frames(tmp_path / "other.h5")

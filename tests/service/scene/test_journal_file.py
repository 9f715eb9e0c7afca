"""Frames of a run under way are read from the journal as the finished files will hold them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from demcore import recorder
from demcore.geometry.walls import Wall
from demcore.recorder import SeriesRecorder
from service.scene.journal_file import JOURNAL, list_journal, read_journal_spheres, read_journal_surface
from service.scene.sphere_file import Unreadable, list_frames, read_spheres, read_surface
from tests.demcore.builders import bed

FRAMES = 4


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run with its journal and its finished files; a wall moves until it is taken away."""
    folder = tmp_path_factory.mktemp("series")
    walls = [Wall("plane"), Wall("cylinder", radius=0.06, length=0.5, velocity=(0.0, 0.0, 2.0))]
    simulation, series = bed(count=60, walls=walls), SeriesRecorder(folder, 0.01)
    simulation.floor = 0.05
    for k in range(FRAMES):
        if k == FRAMES - 1:
            simulation.remove_wall(1)
        series.frame(simulation.time, simulation)
        simulation.advance(400)
    series.finish()
    return folder


def test_a_journal_holds_what_the_finished_files_hold(recorded: Path) -> None:
    journal, spheres, walls = (recorded / name for name in (JOURNAL, "spheres.vtkhdf", "walls.vtkhdf"))
    assert list_journal(journal) == list_frames(spheres)
    for k in range(FRAMES):
        found, kept = read_journal_spheres(journal, k), read_spheres(spheres, k)
        assert np.array_equal(found.positions, kept.positions) and np.array_equal(found.radii, kept.radii)
        assert found.data.keys() == kept.data.keys() and found.time_s == kept.time_s
        assert all(np.array_equal(found.data[name], kept.data[name]) for name in kept.data)
        surface, whole = read_journal_surface(journal, k), read_surface(walls, k)
        assert np.array_equal(surface.points, whole.points) and np.array_equal(surface.walls, whole.walls)
        assert np.array_equal(surface.triangles, whole.triangles)


def test_the_journal_has_the_name_that_the_recorder_gives_it() -> None:
    assert recorder.JOURNAL == JOURNAL


def test_a_frame_that_is_being_written_is_not_shown(recorded: Path, tmp_path: Path) -> None:
    path = tmp_path / JOURNAL
    whole = (recorded / JOURNAL).read_bytes()
    for lost in (1, 5000):
        path.write_bytes(whole[:-lost])
        assert len(list_journal(path).times_s) == FRAMES - 1
        with pytest.raises(IndexError):
            read_journal_spheres(path, FRAMES - 1)
    path.write_bytes(whole[:20])
    assert list_journal(path).times_s == ()


def test_a_spoilt_or_absent_journal_is_unreadable(recorded: Path, tmp_path: Path) -> None:
    path = tmp_path / JOURNAL
    with pytest.raises(Unreadable, match="cannot be read"):
        list_journal(path)
    content = bytearray((recorded / JOURNAL).read_bytes())
    content[300] ^= 1
    path.write_bytes(content)
    with pytest.raises(Unreadable, match="written anew"):
        list_journal(path)

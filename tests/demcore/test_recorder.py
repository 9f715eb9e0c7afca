"""A recorded run: its spheres and walls step by step, and a run that was killed leaves the same files."""

from __future__ import annotations

import numpy as np
import pytest

from demcore.errors import InputError
from demcore.geometry.walls import Wall
from demcore.recorder import SeriesRecorder
from tests.demcore.builders import bed
from tests.demcore.output.vtk_reading import read_steps

WALLS = (
    Wall("plane"),
    Wall("disc", radius=0.1, material=0),
    Wall("cylinder", radius=0.06, length=0.5, velocity=(0.0, 0.0, 2.0)),
)


def falling():
    simulation = bed(count=60, walls=list(WALLS))
    simulation.floor = 0.05
    return simulation


def record(recorder, simulation, frames, first=0):
    """A frame every 200 steps; the spheres fall below the floor and leave, the cylinder travels."""
    for k in range(first, frames):
        if k > first:
            simulation.advance(200)
        recorder.frame(simulation.time, simulation)


def test_spheres_and_walls_come_back_as_they_were(tmp_path):
    recorder, simulation = SeriesRecorder(tmp_path, 0.01), falling()
    seen = []
    for _ in range(5):
        recorder.frame(simulation.time, simulation)
        seen.append((simulation.time, simulation.particles.number.copy(), simulation.particles.state.copy()))
        simulation.advance(400)
    simulation.remove_wall(2)
    recorder.frame(simulation.time, simulation)
    recorder.finish()
    recorder.discard_journal()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["spheres.vtkhdf", "walls.vtkhdf"]
    steps = read_steps(tmp_path / "spheres.vtkhdf")
    assert len({read.n_points for _, read in steps}) > 1
    for (time, read), (at, number, rows) in zip(steps, seen, strict=False):
        assert time == at
        np.testing.assert_array_equal(read["Number"], np.sort(number))
        state = rows[np.argsort(number)].astype(np.float32)
        np.testing.assert_array_equal(read.points, state[:, :3])
        np.testing.assert_array_equal(read["Radius"], state[:, 3])
        np.testing.assert_array_equal(read["Velocity"], state[:, 4:7])
        np.testing.assert_array_equal(read["AngularVelocity"], state[:, 8:11])
    walls = read_steps(tmp_path / "walls.vtkhdf")
    for (_, read), (at, _, _) in zip(walls, seen, strict=False):
        tube = read.extract_cells(read["Wall"] == 2)
        assert tube.bounds[4:] == pytest.approx((2.0 * at, 2.0 * at + 0.5), abs=1e-6)
        assert tube.bounds[:2] == pytest.approx((-0.06, 0.06), abs=1e-6)
    # Vanished: nothing of it is left, the others are.
    assert set(walls[-1][1]["Wall"]) == {0, 1}


def test_a_plane_is_shown_below_the_particles(tmp_path):
    recorder, simulation = SeriesRecorder(tmp_path, 0.01), bed(count=50)
    simulation.particles.state[:, 0] += 5.0
    recorder.frame(0.0, simulation)
    recorder.finish()
    ((_, read),) = read_steps(tmp_path / "walls.vtkhdf")
    plane = read.extract_cells(read["Wall"] == 0)
    assert plane.bounds[0] < 4.94 and plane.bounds[1] > 5.06
    assert plane.bounds[4:] == (0.0, 0.0)


def test_a_run_that_was_killed_leaves_the_files_of_one_that_was_not(tmp_path):
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    whole.mkdir()
    killed.mkdir()
    recorder = SeriesRecorder(whole, 0.01)
    record(recorder, falling(), 6)
    recorder.finish()
    # Killed after five frames, the last of them torn; its checkpoint is older than two of them.
    record(SeriesRecorder(killed, 0.01), falling(), 5)
    journal = killed / "series.journal"
    journal.write_bytes(journal.read_bytes()[:-20])
    (killed / "spheres.running.vtkhdf").write_bytes(b"spoilt")
    again = falling()
    again.advance(400)
    recorder = SeriesRecorder(killed, 0.01)
    recorder.rewind(again.time)
    # The driver shows the state that it goes on from once more: no frame may be double.
    record(recorder, again, 6, first=2)
    recorder.finish()
    assert len(read_steps(killed / "spheres.vtkhdf")) == 6
    for name in ("spheres.vtkhdf", "walls.vtkhdf"):
        assert (killed / name).read_bytes() == (whole / name).read_bytes()


def test_a_new_run_forgets_the_frames_of_an_old_one(tmp_path):
    record(SeriesRecorder(tmp_path, 0.01), falling(), 4)
    recorder = SeriesRecorder(tmp_path, 0.01)
    record(recorder, falling(), 2)
    recorder.finish()
    assert len(read_steps(tmp_path / "spheres.vtkhdf")) == 2


def test_a_run_without_particles_is_recorded_too(tmp_path):
    simulation = falling()
    recorder = SeriesRecorder(tmp_path, 0.01)
    recorder.frame(0.0, simulation)
    simulation.floor = 1e9
    simulation.stale = True
    simulation.advance(1)
    recorder.frame(simulation.time, simulation)
    recorder.finish()
    assert [read.n_points for _, read in read_steps(tmp_path / "spheres.vtkhdf")] == [60, 0]


@pytest.mark.parametrize("interval", [0.0, -1.0, float("nan"), float("inf")])
def test_an_interval_that_is_no_time_is_refused(interval, tmp_path):
    with pytest.raises(InputError, match="frame_interval"):
        SeriesRecorder(tmp_path, interval)

"""The result file of a case: same run same bytes, readable by anyone's HDF5, and particles that VTK shows."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import h5py
import numpy as np
import pytest
import pyvista

from demcore.case_file import SHOWN, write_case
from demcore.geometry.mesh import TriangleMesh
from demcore.geometry.walls import Wall
from demcore.output.result_file import PACKAGE, program_version, read_result
from demcore.region import Box
from demcore.run import simulate
from demcore.source_hash import hash_sources
from tests.demcore.cases import TUBE, a_case, a_feed, a_fill

FLOOR = TriangleMesh(
    np.array([[-0.08, -0.08, 0.0], [0.08, -0.08, 0.0], [0.08, 0.08, 0.0], [-0.08, 0.08, 0.0]]),
    np.array([[0, 1, 2], [0, 2, 3]]),
)
# A fill and a feed on a floor of two triangles, of which some fall over its edge.
CASE = a_case(
    fills=(a_fill(mass=0.2),),
    feeds=(a_feed(stop=0.2),),
    walls=(Wall("mesh", mesh=FLOOR), Wall("cylinder", (0.0, 0.0, 0.03), radius=TUBE, length=9.0)),
    domain=Box((-0.2, -0.2, -0.05), (0.2, 0.2, math.inf)),
    duration=0.4,
    seed=11,
)


@pytest.fixture(scope="module")
def result():
    return simulate(CASE)


@pytest.fixture(scope="module")
def path(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("case") / "result.vtkhdf"
    write_case(result, path)
    return path


def test_the_same_run_gives_the_same_bytes_whatever_the_clock_said(result, path, tmp_path):
    again = simulate(CASE, threads=2)
    assert again.wall_s != result.wall_s
    write_case(again, tmp_path / "again")
    assert (tmp_path / "again").read_bytes() == path.read_bytes()
    assert [file.name for file in tmp_path.iterdir()] == ["again"]


def test_another_seed_gives_another_file(path, tmp_path):
    write_case(simulate(replace(CASE, seed=12)), tmp_path / "other")
    assert read_result(tmp_path / "other").seed == 12
    assert (tmp_path / "other").read_bytes() != path.read_bytes()


def test_any_reader_of_hdf5_learns_what_was_asked_and_what_came_out(result, path):
    with h5py.File(path, "r") as file:
        assert dict(file.attrs) == {
            "format": "talus-result-1",
            "kind": "case",
            "seed": 11,
            "version": program_version(),
            "source_sha256": hash_sources(PACKAGE),
        }
        case, summary = (json.loads(file[name].asstr()[()]) for name in ("case", "summary"))
        units = {name: file[f"particles/{name}"].attrs["units"] for name in file["particles"]}
        np.testing.assert_array_equal(file["particles/position"], result.positions)
        np.testing.assert_array_equal(file["walls/0/vertices"], FLOOR.vertices)
        np.testing.assert_array_equal(file["walls/0/faces"], FLOOR.faces)
        lost = file["departures/mass"][()].sum()
        assert list(file["departures/time"]) == [step * CASE.dt for step in file["departures/step"]]
    assert units == {
        "number": "1",
        "position": "m",
        "velocity": "m/s",
        "spin": "rad/s",
        "radius": "m",
        "mass": "kg",
        "material": "1",
    }
    assert case["duration"] == 0.4
    assert case["domain"]["upper"] == [0.2, 0.2, None]
    assert [part["material"] for part in case["feeds"][0]["mix"]] == ["gravel", "sand"]
    assert summary["ended"] == result.ended
    assert summary["assumptions"]["seed"] == 11
    assert not any("wall_s" in name for name in summary)
    # Nothing is lost: what was filled and fed is there or has left.
    assert lost > 0.0
    came = summary["filled_kg"] + sum(feed["born_kg"] for feed in summary["feeds"])
    assert summary["mass_kg"] + lost == pytest.approx(came, rel=1e-12)


def test_what_is_read_back_is_what_the_run_had(result, path):
    stored = read_result(path)
    groups = {name.split("/")[0] for name in stored.columns}
    assert groups == {"particles", "departures", "history", "walls"}
    for name, values in (
        ("particles/number", result.numbers),
        ("particles/velocity", result.velocities),
        ("particles/spin", result.spins),
        ("particles/radius", result.radii),
        ("particles/mass", result.masses),
        ("particles/material", result.material_rows),
        ("departures/number", result.departures.number),
        ("departures/side", result.departures.side),
        ("history/kinetic_energy", [reading.kinetic_energy for reading in result.history]),
        ("history/particles", [reading.particles for reading in result.history]),
    ):
        np.testing.assert_array_equal(stored.columns[name].values, values)
        assert stored.columns[name].meaning


def test_vtk_shows_the_particles_in_full_precision(result, path):
    read = pyvista.read(path)
    assert read.n_cells == len(result.numbers)
    np.testing.assert_array_equal(read.points, result.positions)
    stored = read_result(path)
    assert set(read.point_data.keys()) == set(SHOWN) - {"Points"}
    for vtk, column in SHOWN.items():
        if vtk != "Points":
            np.testing.assert_array_equal(read.point_data[vtk], stored.columns[column].values)
    # Kept once, under two names.
    with h5py.File(path, "r") as file:
        assert file["VTKHDF/Points"] == file["particles/position"]


def test_a_run_that_nothing_is_left_of_has_a_file_too(tmp_path):
    result = simulate(a_case(walls=(), domain=Box((-1.0, -1.0, -0.1), (1.0, 1.0, 2.0))))
    write_case(result, tmp_path / "empty.vtkhdf")
    stored = read_result(tmp_path / "empty.vtkhdf")
    assert stored.summary["ended"] == "empty"
    assert stored.columns["particles/position"].values.shape == (0, 3)
    assert len(stored.columns["departures/number"].values) == stored.summary["departed"] > 0
    assert pyvista.read(tmp_path / "empty.vtkhdf").n_points == 0

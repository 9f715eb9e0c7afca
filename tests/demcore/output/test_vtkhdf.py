"""VTKHDF files are read back by VTK itself, through pyvista: every step, whatever its size."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import pyvista

from demcore.output.spheres import SPHERE_FIELDS, vertices, write_spheres
from demcore.output.tessellation import revolution, square
from demcore.output.vtkhdf import Field, PolyData, PolyDataSeries
from tests.demcore.output.vtk_reading import read_steps


def spheres(count, seed):
    rng = np.random.default_rng(seed)
    data = {
        "Radius": rng.random(count, np.float32),
        "Velocity": rng.random((count, 3), np.float32),
        "AngularVelocity": rng.random((count, 3), np.float32),
        "Material": rng.integers(1, 5, count, np.int32),
        "Number": rng.integers(0, 2**40, count),
    }
    return PolyData(rng.random((count, 3), np.float32), vertices(count), data, {})


def test_steps_of_unlike_size_come_back_with_their_time(tmp_path):
    # None at all, more than a chunk holds, and one.
    frames = [(0.0, spheres(5, 1)), (0.1, spheres(0, 2)), (0.25, spheres(20_000, 3)), (0.3, spheres(1, 4))]
    with PolyDataSeries(tmp_path / "a.vtkhdf", "Vertices", SPHERE_FIELDS) as series:
        for time, data in frames:
            series.append(time, data)
    steps = read_steps(tmp_path / "a.vtkhdf")
    assert [time for time, _ in steps] == [0.0, 0.1, 0.25, 0.3]
    for (_, read), (_, written) in zip(steps, frames, strict=True):
        np.testing.assert_array_equal(read.points.reshape(-1, 3), written.points)
        assert read.n_cells == len(written.points)
        for field in SPHERE_FIELDS:
            if len(written.points):
                np.testing.assert_array_equal(read.point_data[field.name], written.point_data[field.name])


def test_every_vertex_is_a_cell_of_its_own(tmp_path):
    with PolyDataSeries(tmp_path / "a.vtkhdf", "Vertices", SPHERE_FIELDS) as series:
        series.append(0.0, spheres(3, 1))
        series.append(1.0, spheres(2, 1))
    for count, (_, read) in zip((3, 2), read_steps(tmp_path / "a.vtkhdf"), strict=True):
        np.testing.assert_array_equal(read.verts.reshape(-1, 2), [[1, k] for k in range(count)])


def test_a_file_can_be_read_while_it_grows(tmp_path):
    with PolyDataSeries(tmp_path / "a.vtkhdf", "Vertices", SPHERE_FIELDS) as series:
        for k in range(3):
            series.append(0.1 * k, spheres(4 + k, k))
            steps = read_steps(tmp_path / "a.vtkhdf")
            assert [read.n_points for _, read in steps] == [4 + j for j in range(k + 1)]


def test_meshes_move_change_and_stand_still(tmp_path):
    points, triangles = revolution((0.5, 0.0), (0.5, 2.0))
    wall = {"Wall": np.zeros(len(triangles), np.int32)}
    plate, plate_triangles = square(1.0)
    path = tmp_path / "walls.vtkhdf"
    with PolyDataSeries(path, "Polygons", (), (Field("Wall", "i4"),)) as series:
        series.append(0.0, PolyData(points, triangles, {}, wall))
        series.repeat(0.1)
        series.append(0.2, PolyData(points + np.array([0.0, 0.0, 0.3]), triangles, {}, wall))
        series.append(0.3, PolyData(plate, plate_triangles, {}, {"Wall": np.array([7, 7])}))
        series.repeat(0.4)
    steps = [read for _, read in read_steps(path)]
    assert [round(float(read.points[:, 2].min()), 6) for read in steps] == [0.0, 0.0, 0.3, 0.0, 0.0]
    assert [read.n_cells for read in steps] == [128, 128, 128, 2, 2]
    for read in steps[:3]:
        # Area of a 64-sided tube: 64 sides of 2 r sin(pi/64) times its length.
        assert read.area == pytest.approx(64 * 2 * 0.5 * np.sin(np.pi / 64) * 2.0, rel=1e-5)
    assert steps[4].area == pytest.approx(4.0)
    assert steps[4].cell_data["Wall"].tolist() == [7, 7]


def test_same_steps_same_bytes(tmp_path):
    for name in "ab":
        with PolyDataSeries(tmp_path / name, "Vertices", SPHERE_FIELDS) as series:
            for k in range(4):
                series.append(0.1 * k, spheres(6000 + k, k))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_a_single_pile_keeps_double_precision_and_pyvista_reads_it(tmp_path):
    rng = np.random.default_rng(1)
    position, radius = rng.random((7, 3)), rng.random(7)
    write_spheres(
        tmp_path / "pile.vtkhdf", position, radius, {"Velocity": position, "Material": [1] * 7}, {"a": 1}
    )
    read = pyvista.read(tmp_path / "pile.vtkhdf")
    np.testing.assert_array_equal(read.points, position)
    np.testing.assert_array_equal(read.point_data["Diameter"], 2.0 * radius)
    np.testing.assert_array_equal(read.point_data["Velocity"], position)
    assert [path.name for path in tmp_path.iterdir()] == ["pile.vtkhdf"]


def test_a_cone_a_disc_and_a_tube_have_the_area_of_their_polygons():
    side = 2.0 * np.sin(np.pi / 64)
    height = np.cos(np.pi / 64)
    for start, end, area in (
        ((0.0, 0.0), (1.0, 0.0), 64 * 0.5 * side * height),
        ((1.0, 0.0), (0.0, 0.0), 64 * 0.5 * side * height),
        ((0.0, 0.0), (1.0, 1.0), 64 * 0.5 * side * np.sqrt(1.0 + height**2)),
        ((1.0, 0.0), (1e-17, 0.0), 64 * 0.5 * side * height),
        ((0.5, 0.0), (1.0, 0.0), 64 * 0.5 * side * height * 0.75),
    ):
        points, triangles = revolution(start, end)
        mesh = pyvista.PolyData.from_regular_faces(points, triangles)
        assert mesh.area == pytest.approx(area)


def test_the_page_on_paraview_names_arrays_that_there_are() -> None:
    """docs/paraview.md: every capitalised name in code marks is an array of the spheres."""
    page = (Path(__file__).resolve().parents[3] / "docs/paraview.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([A-Z][A-Za-z]+)`", page))
    assert {"Radius", "Material", "Velocity"} <= named <= {field.name for field in SPHERE_FIELDS}

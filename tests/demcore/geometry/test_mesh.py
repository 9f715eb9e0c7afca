"""Meshes that are refused, and the tree that finds triangles, against brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest

from demcore.contact.model import Vec3
from demcore.errors import InputError
from demcore.geometry.mesh import TriangleMesh
from demcore.geometry.surfaces import triangle_distance
from demcore.geometry.wall_arrays import wall_arrays
from demcore.geometry.walls import Wall
from demcore.wall_search import collect_slots

SQUARE = [[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


@pytest.mark.parametrize(
    ("vertices", "faces", "named"),
    [
        (SQUARE, [], "mesh.faces"),
        ([], [[0, 1, 2]], "mesh.vertices"),
        ([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], "mesh.vertices"),
        (SQUARE, [[0, 1]], "mesh.faces"),
        (SQUARE, [[0, 1, 2.5]], "mesh.faces"),
        ("box", [[0, 1, 2]], "mesh.vertices"),
        ([[0, 0, 0], [1, 0, math.nan], [0, 1, 0]], [[0, 1, 2]], "mesh.vertices[1]"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, -math.inf]], [[0, 1, 2]], "mesh.vertices[2]"),
        ([[0, 0, 0], [1, 0, 0], [0, 1e30, 0]], [[0, 1, 2]], "mesh.vertices[2]"),
        (SQUARE, [[0, 1, 2], [0, 2, 4]], "mesh.faces[1]"),
        (SQUARE, [[0, 1, 2], [0, 2, -1]], "mesh.faces[1]"),
        (SQUARE, [[0, 1, 2], [0, 2, 3], [2, 2, 3]], "mesh.faces[2]"),
        ([[0, 0, 0], [1, 1, 1], [3, 3, 3]], [[0, 1, 2]], "mesh.faces[0]"),
        ([[0, 0, 0], [1, 0, 0], [0.5, 1e-14, 0]], [[0, 1, 2]], "mesh.faces[0]"),
        ([[0, 0, 0], [0, 0, 0], [0, 0, 0]], [[0, 1, 2]], "mesh.faces[0]"),
    ],
)
def test_a_bad_mesh_is_refused_with_its_place(vertices, faces, named):
    with pytest.raises(InputError) as caught:
        TriangleMesh(vertices, faces)
    assert caught.value.field == named


def test_tiny_and_thin_triangles_are_meshes():
    for scale in (1e-9, 1.0, 1e6):
        mesh = TriangleMesh(np.array([[0, 0, 0], [1, 0, 0], [0.5, 1e-6, 0]]) * scale, [[0, 1, 2]])
        assert mesh.normals()[0] == pytest.approx([0, 0, 1])


def test_a_mesh_cannot_be_changed_and_knows_itself():
    points = np.array(SQUARE)
    mesh = TriangleMesh(points, [[0, 1, 2]])
    points[0] = 5.0
    assert mesh.vertices[0].tolist() == [0, 0, 0]
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices[0, 0] = 1.0
    assert mesh.fingerprint() == TriangleMesh(SQUARE, [[0, 1, 2]]).fingerprint()
    assert mesh.fingerprint() != TriangleMesh(SQUARE, [[0, 2, 1]]).fingerprint()


@pytest.mark.parametrize("count", [1, 3, 4, 5, 64, 333])
def test_the_tree_finds_every_triangle_within_reach(count):
    # Large and tiny triangles mixed, the mesh turned and shifted as a wall.
    rng = np.random.default_rng(count)
    size = 10.0 ** rng.uniform(-3, 0.3, (count, 1, 1))
    corners = rng.normal(size=(count, 1, 3)) + size * rng.normal(size=(count, 3, 3))
    mesh = TriangleMesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))
    walls = wall_arrays([Wall("plane", centre=(0, 0, -99)), Wall("mesh", mesh=mesh, centre=(0.5, 0, 0))])
    state = np.zeros((60, 12))
    state[:, :3], state[:, 3] = rng.normal(size=(60, 3)) * 1.5, rng.uniform(0.01, 0.4, 60)
    slots = collect_slots(state, state[:, 3] + 0.05, walls, 0, 1e-3)
    found = {(int(i), int(t)) for i, w, t in slots if w == 1}
    expected = {
        (i, t)
        for i in range(60)
        for t in range(count)
        if triangle_distance(walls.triangle, t, Vec3(*(state[i, :3] - [0.5, 0, 0])))[0] < state[i, 3] + 0.05
    }
    assert found == expected
    assert len(found) == len(slots)
    # Sorted along the curve, the triangles are those of the mesh.
    assert sorted(map(tuple, walls.triangle[:, :9])) == sorted(map(tuple, corners.reshape(-1, 9)))


def test_the_tree_of_a_large_mesh_looks_at_few_boxes():
    # 20,000 triangles of a hopper: memory of the tree below one row per triangle.
    from tests.demcore.wall_builders import plate_mesh

    walls = wall_arrays([Wall("mesh", mesh=plate_mesh(10.0, 100, 0.3))])
    assert len(walls.triangle) == 20_000
    assert len(walls.box) <= 16_384

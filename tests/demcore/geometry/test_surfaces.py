"""Distances and normals of every shape against brute force: points sampled densely on the surface."""

from __future__ import annotations

import math

import numpy as np
import pytest

from demcore.contact.model import Vec3
from demcore.geometry.mesh import TriangleMesh
from demcore.geometry.surfaces import EDGE, FACE, VERTEX, triangle_distance
from demcore.geometry.wall_arrays import wall_arrays
from demcore.geometry.walls import Wall
from demcore.wall_forces import wall_distance

TILT = {"centre": (0.1, -0.2, 0.3), "axis": (1.0, -2.0, 0.5)}
SHAPES = {
    "disc": Wall("disc", radius=0.5, **TILT),
    "ring": Wall("disc", radius=0.5, inner_radius=0.2, **TILT),
    "cylinder": Wall("cylinder", radius=0.3, length=0.7, **TILT),
    "funnel": Wall("cone", radius=0.4, end_radius=0.1, length=0.3, **TILT),
    "widening cone": Wall("cone", radius=0.1, end_radius=0.6, length=0.2, **TILT),
    "tip": Wall("cone", radius=0.0, end_radius=0.3, length=0.5, **TILT),
}


def sampled(wall, n=700):
    """Points on the surface, from the definition of the shape rather than from a profile."""
    axis = np.array(wall.axis) / math.sqrt(sum(a * a for a in wall.axis))
    one = np.cross(axis, [0.0, 0.0, 1.0])
    one /= np.sqrt((one**2).sum())
    two = np.cross(axis, one)
    share, angle = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 2 * np.pi, n))
    share, angle = share.ravel()[:, None], angle.ravel()[:, None]
    if wall.kind == "disc":
        radius, height = wall.inner_radius + share * (wall.radius - wall.inner_radius), 0.0
    else:
        end = wall.radius if wall.kind == "cylinder" else wall.end_radius
        radius, height = wall.radius + share * (end - wall.radius), share * wall.length
    return np.array(wall.centre) + height * axis + radius * (np.cos(angle) * one + np.sin(angle) * two)


@pytest.mark.parametrize("name", SHAPES)
def test_a_shape_is_as_far_as_its_nearest_sampled_point(name):
    wall = SHAPES[name]
    walls, points = wall_arrays([wall]), sampled(wall)
    rng = np.random.default_rng(3)
    for q in np.array(wall.centre) + rng.uniform(-0.8, 0.8, (60, 3)):
        d, n = wall_distance(walls.kind[0], walls.shape, walls.pose, 0, *q)
        n = np.array(n)
        squared = ((points - q) ** 2).sum(axis=1)
        nearest = math.sqrt(squared.min())
        # Samples lie up to 3 mm from the true nearest point, which costs half its square over the distance.
        assert -1e-12 <= nearest - d <= min(0.003, 0.003**2 / d)
        assert (n**2).sum() == pytest.approx(1.0, abs=1e-12)
        # The foot is a point of the surface: from there the surface is at no distance.
        assert wall_distance(walls.kind[0], walls.shape, walls.pose, 0, *(q - d * n))[0] < 1e-12


def test_a_plane_is_solid_below_its_axis():
    walls = wall_arrays([Wall("plane", centre=(0.0, 0.0, 1.0), axis=(0.0, 3.0, 4.0))])
    for q in ((0.3, 0.1, 2.0), (-5.0, 0.1, 0.5)):
        d, n = wall_distance(walls.kind[0], walls.shape, walls.pose, 0, *q)
        assert d == pytest.approx(0.6 * q[1] + 0.8 * (q[2] - 1.0), abs=1e-15)
        assert tuple(n) == pytest.approx((0.0, 0.6, 0.8), abs=1e-15)


@pytest.mark.parametrize(
    ("wall", "point", "distance"),
    [
        (Wall("disc", radius=0.5), (0.0, 0.0, 0.2), 0.2),
        (Wall("disc", radius=0.5, inner_radius=0.3), (0.0, 0.0, 0.4), 0.5),
        (Wall("cylinder", radius=0.5, length=1.0), (0.0, 0.0, 0.5), 0.5),
        (Wall("cone", radius=0.3, end_radius=0.0, length=0.4), (0.0, 0.0, 0.0), 0.24),
    ],
)
def test_on_the_axis_there_is_a_distance_too(wall, point, distance):
    # A ball dropped on the axis of a funnel or an orifice must not fall through.
    walls = wall_arrays([wall])
    d, n = wall_distance(walls.kind[0], walls.shape, walls.pose, 0, *point)
    assert d == pytest.approx(distance, abs=1e-15)
    assert math.hypot(*n) == pytest.approx(1.0)


def nearest_by_projection(corners, q):
    """Distance to a triangle by another way: alternate projections onto its plane and edges' half planes, all
    seven candidates (face, three edges, three corners) formed and the best feasible one taken."""
    a, b, c = corners
    best = min(float(np.sqrt(((p - q) ** 2).sum())) for p in corners)
    for p, r in ((a, b), (b, c), (c, a)):
        t = np.clip(((q - p) @ (r - p)) / ((r - p) @ (r - p)), 0.0, 1.0)
        best = min(best, float(np.sqrt(((p + t * (r - p) - q) ** 2).sum())))
    share, *_ = np.linalg.lstsq(np.column_stack([b - a, c - a]), q - a, rcond=None)
    if share.min() >= 0.0 and share.sum() <= 1.0:
        foot = a + share[0] * (b - a) + share[1] * (c - a)
        best = min(best, float(np.sqrt(((foot - q) ** 2).sum())))
    return best


@pytest.mark.parametrize("stretch", [1.0, 1e-3, 1e-6])
def test_random_triangles_against_all_seven_candidates(stretch):
    # Slivers too: one height is `stretch` of the longest edge.
    rng = np.random.default_rng(7)
    corners = rng.normal(size=(300, 3, 3))
    middle = 0.5 * (corners[:, 0] + corners[:, 1])
    corners[:, 2] = middle + stretch * (corners[:, 2] - middle)
    mesh = TriangleMesh(corners.reshape(-1, 3), np.arange(900).reshape(-1, 3))
    rows = np.hstack([mesh.corners().reshape(-1, 9), mesh.normals()])
    for t in range(300):
        for q in (rng.normal(size=3), corners[t].mean(axis=0) + 1e-3 * rng.normal(size=3)):
            d, n, _ = triangle_distance(rows, t, Vec3(*q))
            expected = nearest_by_projection(corners[t], q)
            assert d == pytest.approx(expected, rel=1e-6, abs=1e-9)
            assert math.hypot(*n) == pytest.approx(1.0, abs=1e-9)


def test_the_feature_is_named():
    mesh = TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    rows = np.hstack([mesh.corners().reshape(-1, 9), mesh.normals()])
    for q, d, n, feature in (
        ((0.2, 0.2, 0.5), 0.5, (0, 0, 1), FACE),
        ((0.2, 0.2, -0.5), 0.5, (0, 0, -1), FACE),
        ((0.5, -0.3, 0.4), 0.5, (0, -0.6, 0.8), EDGE),
        ((1.0, 1.0, 0.0), math.sqrt(0.5), (math.sqrt(0.5), math.sqrt(0.5), 0), EDGE),
        ((-0.3, -0.4, 0.0), 0.5, (-0.6, -0.8, 0), VERTEX),
        # A foot on the edge counts as face: it comes first.
        ((0.5, 0.0, 0.5), 0.5, (0, 0, 1), FACE),
    ):
        found = triangle_distance(rows, 0, Vec3(*map(float, q)))
        assert found[0] == pytest.approx(d)
        assert tuple(found[1]) == pytest.approx(n, abs=1e-12)
        assert found[2] == feature

"""Orthographic views: what is projected where, which edges an eye sees, and what is cut off."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from demcore.canvas import FRONT, PAPER, SIDE, TOP, Canvas, clip_segment, fit_frame, seen_edges
from demcore.experiments.plant_drawing import draw_plant
from demcore.output.tessellation import revolution
from demcore.plant.plant_file import load_plant

CUBE = np.array([(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([t for a, b, c, d in SIDES for t in ((a, b, c), (a, c, d))])


def lengths(points, edges):
    return np.sqrt(((points[edges[:, 0]] - points[edges[:, 1]]) ** 2).sum(axis=1))


def test_a_cube_shows_its_twelve_edges_and_no_diagonal():
    edges = seen_edges(CUBE, FACES, np.array([0.0, -1.0, 0.0]))
    assert len(edges) == 12
    assert lengths(CUBE, edges) == pytest.approx(np.ones(12))


def test_corners_that_coincide_are_one():
    apart = CUBE[FACES].reshape(-1, 3)
    edges = seen_edges(apart, np.arange(36).reshape(12, 3), np.array([0.0, -1.0, 0.0]))
    assert len(edges) == 12


def test_a_tube_shows_its_rims_and_two_sides():
    points, triangles = revolution((1.0, 0.0), (1.0, 2.0))
    edges = seen_edges(points, triangles, np.array([0.1, -1.0, 0.0]))
    upright = np.abs(points[edges[:, 0], 2] - points[edges[:, 1], 2]) > 1.9
    assert upright.sum() == 2
    assert len(edges) == 2 * 64 + 2


@pytest.mark.parametrize("view", [FRONT, SIDE, TOP])
def test_a_frame_holds_its_box_centred_and_upright(view):
    lower, upper = np.array([-1.0, -2.0, -3.0]), np.array([3.0, 2.0, 1.0])
    frame = fit_frame(view, (10, 20, 300, 200), lower, upper)
    assert np.cross(view.right, view.up) == pytest.approx(view.toward)
    pixels = frame.project(np.array([lower, upper, 0.5 * (lower + upper)]))
    assert pixels[2, :2] == pytest.approx((150.0, 100.0))
    assert (pixels[:2, :2] >= 0.0).all() and (pixels[:2, :2] <= (300.0, 200.0)).all()
    higher = frame.project(np.array([view.up, np.zeros(3)]))
    assert higher[0, 1] < higher[1, 1]


def test_segments_are_cut_off_at_the_edge():
    size = (10.0, 10.0)
    assert clip_segment(np.array([-5.0, 5.0]), np.array([15.0, 5.0]), size) == ((0.0, 5.0), (10.0, 5.0))
    assert clip_segment(np.array([1.0, 2.0]), np.array([3.0, 4.0]), size) == ((1.0, 2.0), (3.0, 4.0))
    assert clip_segment(np.array([-5.0, -1.0]), np.array([15.0, -1.0]), size) is None
    assert clip_segment(np.array([-2.0, 9.0]), np.array([2.0, 13.0]), size) is None


def test_the_nearer_sphere_hides_the_farther_one():
    canvas = Canvas(100, 100)
    frame = fit_frame(FRONT, (0, 0, 100, 100), np.full(3, -1.0), np.full(3, 1.0))
    red, blue = [255.0, 0.0, 0.0], [0.0, 0.0, 255.0]
    centres = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    canvas.spheres(frame, centres, np.array([0.2, 0.5]), np.array([red, blue]))
    picture = np.array(canvas.image)
    middle, ring, outside = picture[50, 50], picture[50, 64], picture[5, 5]
    assert middle[0] > 100 and middle[2] == 0
    assert ring[2] > 60 and ring[0] == 0
    assert tuple(outside) == PAPER


def test_the_plant_is_drawn_from_three_sides(tmp_path):
    path = tmp_path / "plant.png"
    draw_plant(load_plant(), path)
    assert [file.name for file in tmp_path.iterdir()] == ["plant.png"]
    picture = np.array(Image.open(path).convert("RGB")).astype(int)
    red = (picture[:, :, 0] > 180) & (picture[:, :, 1] < 90) & (picture[:, :, 2] < 90)
    height, width = red.shape
    # The deflector is seen in the front view, in the side view and in the plan.
    assert red[: height // 2, : width // 2].any()
    assert red[: height // 2, width * 3 // 5 :].any()
    assert red[height // 2 :, : width // 2].any()

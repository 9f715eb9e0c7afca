"""A surface in triangles must feel as the analytic one: same bounce, same rolling, one contact per place."""

from __future__ import annotations

import math

import numpy as np
import pytest

from demcore.case import Interaction
from demcore.errors import BlowUp
from demcore.geometry.mesh import TriangleMesh
from demcore.geometry.walls import Wall
from demcore.simulation import FEW_SQUEEZED
from tests.demcore.wall_builders import (
    RADIUS,
    G,
    joined,
    moved,
    plate_mesh,
    resting_overlap,
    single,
    touching,
    tube_mesh,
)

PLANE = Wall("plane")
REST = RADIUS - resting_overlap()
# A tilted frame, so that nothing is saved by coordinates that are zero.
TILT = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
TILT *= np.sign(np.linalg.det(TILT))


def t_junctions():
    """One large triangle beside many small ones: vertices of these lie on its long edge."""
    left = TriangleMesh([[-1, -1, 0], [0, -1, 0], [0, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    return joined(left, moved(plate_mesh(2.0, 21, 0.3, 4), np.eye(3), [1.0, 0.0, 0.0]))


PLATES = {
    "regular": plate_mesh(2.0, 40),
    "jittered": plate_mesh(2.0, 40, 0.4, 2),
    "one triangle": TriangleMesh([[-9, -9, 0], [9, -9, 0], [0, 18, 0]], [[0, 1, 2]]),
    "T-junctions": t_junctions(),
    "turned over": TriangleMesh(plate_mesh(2.0, 40).vertices, plate_mesh(2.0, 40).faces[:, ::-1]),
    "soup": joined(*[TriangleMesh(c, [[0, 1, 2]]) for c in plate_mesh(2.0, 12).corners()]),
}


def apart(a, b):
    """Largest difference of two states, in radii, radii per second and rad/s."""
    scale = np.array([RADIUS] * 3 + [1.0] + [RADIUS] * 3 + [1.0] + [1.0] * 4)
    order_a, order_b = np.argsort(a.particles.number), np.argsort(b.particles.number)
    return float((np.abs(a.particles.state[order_a] - b.particles.state[order_b]) / scale).max())


@pytest.mark.parametrize("name", PLATES)
def test_bouncing_sliding_and_rolling_as_on_the_plane(name):
    # 16 balls over edges, corners and faces: thrown obliquely with spin, they bounce, slide, then roll, and
    # each crosses some tens of edges. Expected: the analytic plane, whose decelerations `verify` checks.
    rng = np.random.default_rng(1)
    x, y = np.meshgrid(np.linspace(-0.45, 0.45, 4), np.linspace(-0.45, 0.45, 4))
    start = np.column_stack([x.ravel(), y.ravel(), np.full(16, 1.5 * RADIUS)])
    start[0, :2] = 0.0
    velocity, spin = rng.uniform(-0.3, 0.3, (16, 3)), rng.uniform(-30, 30, (16, 3))
    runs = []
    for wall in (PLANE, Wall("mesh", mesh=PLATES[name])):
        s = single([wall], start, velocity, spin, Interaction(0.3, 0.3, 0.25, 0.02))
        s.advance(int(0.35 / s.dt))
        runs.append(s)
    assert apart(*runs) < 1e-9
    assert touching(runs[1]) == 16
    # They did move over edges: farther than a cell.
    assert np.abs(runs[1].particles.state[:, :2] - start[runs[1].particles.number, :2]).max() > 0.05


def test_the_frame_does_not_matter():
    # The same ball and plate in a tilted frame, friction and rolling resistance on: equal to rounding.
    velocity, spin = np.array([0.5, 0.2, 0.0]), np.array([0.0, 5.0, 3.0])
    start, gravity = np.array([0.01, 0.02, REST]), np.array([0.0, 0.0, -G])
    runs = [single([Wall("mesh", mesh=PLATES["jittered"])], start, velocity, spin, gravity=gravity)]
    turned = Wall("mesh", mesh=moved(PLATES["jittered"], TILT, [0.3, 0.1, -0.2]), centre=(1.0, 0.0, 0.0))
    runs.append(
        single(
            [turned], TILT @ start + [1.3, 0.1, -0.2], TILT @ velocity, TILT @ spin, gravity=TILT @ gravity
        )
    )
    for s in runs:
        s.advance(int(0.5 / s.dt))
    a, b = (s.particles.state[0] for s in runs)
    back = np.concatenate([TILT.T @ (b[:3] - [1.3, 0.1, -0.2]), TILT.T @ b[4:7], TILT.T @ b[8:11]])
    assert np.abs(back - np.concatenate([a[:3], a[4:7], a[8:11]])).max() < 1e-8


@pytest.mark.parametrize("mu_r", [0.02, 0.05, 0.10])
def test_rolling_over_edges_decays_as_published(mu_r):
    # physics.md section 3: a = (5/7) mu_r g, 1 %; some 60 edges on the way.
    s = single(
        [Wall("mesh", mesh=plate_mesh(3.0, 60, 0.3))],
        (-0.4, 0.013, REST),
        (1.0, 0.0, 0.0),
        (0.0, 1.0 / RADIUS, 0.0),
        Interaction(0.5, 0.5, 0.5, mu_r),
    )
    s.advance(int(0.05 / s.dt))
    v, t = s.particles.state[0, 4], s.time
    s.advance(int(0.4 / s.dt))
    assert (v - s.particles.state[0, 4]) / (s.time - t) == pytest.approx(5 / 7 * mu_r * G, rel=0.01)
    # Nor does it hop: a jolt at an edge would show in the height.
    assert abs(s.particles.state[0, 2] - REST) < 1e-6 * RADIUS


def test_friction_holds_across_edges_on_a_slope():
    # At rest on 20 degrees with mu = .5 and mu_r = .4: rolling is held, the springs live in the history. The
    # plate creeps underneath, so the contact wanders over edges; it must not slip at any of them.
    th = math.radians(20.0)
    gravity = (G * math.sin(th), 0.0, -G * math.cos(th))
    contact = Interaction(0.5, 0.5, 0.5, 0.4)
    drift = {}
    for name, wall in (("plane", PLANE), ("mesh", Wall("mesh", mesh=plate_mesh(1.0, 100)))):
        s = single([wall], (0.0051, 0.0, RADIUS - resting_overlap(g=G * math.cos(th))), (0, 0, 0), (0, 0, 0),
                   contact, gravity)  # fmt: skip
        s.advance(int(0.5 / s.dt))
        drift[name] = s.particles.state[0].copy()
    assert np.abs(drift["mesh"] - drift["plane"]).max() < 1e-9


def box(size):
    """A closed box about the origin."""
    h = size / 2
    points = [[x, y, z] for x in (-h, h) for y in (-h, h) for z in (-h, h)]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return TriangleMesh(points, [f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))])


def contacts_of(mesh, position, radius=RADIUS):
    """Normals of the contacts of one sphere, after one step without gravity."""
    s = single([Wall("mesh", mesh=mesh, from_time=0.0)], position, gravity=(0, 0, 0), radius=radius)
    s.advance(1)
    near = s.near_walls
    return near.normal[near.history[:, 1] != 0.0]


DEEP = 0.97 * RADIUS


@pytest.mark.parametrize(
    ("position", "normals"),
    [
        ((0.0, 0.0, 0.5 + DEEP), [(0, 0, 1)]),
        ((0.5, 0.0, 0.5 + DEEP), [(0, 0, 1)]),
        ((0.5 + 0.6 * DEEP, 0.0, 0.5 + 0.8 * DEEP), [(0.6, 0, 0.8)]),
        ((0.5 + DEEP / math.sqrt(3),) * 3, [(1 / math.sqrt(3),) * 3]),
        ((0.5 - DEEP, 0.0, 0.0), [(-1, 0, 0)]),
        ((0.5 - DEEP, 0.0, -0.5 + DEEP), [(-1, 0, 0), (0, 0, 1)]),
        ((0.5 - DEEP, 0.5 - DEEP, -0.5 + DEEP), [(-1, 0, 0), (0, -1, 0), (0, 0, 1)]),
    ],
    ids=["face", "over a convex edge", "beside a convex edge", "corner from outside", "inside",
         "inner edge", "inner corner"],
)  # fmt: skip
def test_one_contact_per_place_of_a_box(position, normals):
    found = contacts_of(box(1.0), position)
    assert len(found) == len(normals)
    for n in normals:
        assert np.abs(found - np.array(n)).max(axis=1).min() < 1e-9


def test_a_ball_larger_than_the_triangles_feels_one_plane():
    assert len(contacts_of(plate_mesh(1.0, 200, 0.4), (0.001, 0.002, 0.97 * 0.05), radius=0.05)) == 1


def test_both_sides_of_a_narrow_gap_hold():
    gap = 2.0 * 0.99 * RADIUS
    slot = joined(plate_mesh(1.0, 10), moved(plate_mesh(1.0, 10), np.eye(3), [0.003, 0.001, gap]))
    found = contacts_of(slot, (0.0, 0.0, gap / 2))
    assert np.sort(found[:, 2]) == pytest.approx([-1.0, 1.0])


@pytest.mark.parametrize("degrees", [10.0, 25.0])
def test_a_gentle_valley_is_one_contact_and_a_steep_one_two(degrees):
    a = math.radians(degrees)
    for angle, count in ((a, 1), (a + math.radians(30.0), 2)):
        # Two planes through the y axis; the normals differ by `angle`, the ball lies in the middle.
        h = math.tan(angle / 2)
        valley = TriangleMesh(
            [[-1, -1, h], [0, -1, 0], [1, -1, h], [-1, 1, h], [0, 1, 0], [1, 1, h]],
            [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]],
        )
        found = contacts_of(valley, (0.0, 0.01, DEEP / math.cos(angle / 2)))
        assert len(found) == count


def test_inner_corner_pushes_as_two_planes():
    # Gravity along the diagonal into a 90 degree corner: each plane carries g / sqrt 2.
    gravity = (-G / math.sqrt(2), 0.0, -G / math.sqrt(2))
    floor = plate_mesh(1.0, 10)
    upright = moved(floor, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], [0.0, 0.0, 0.0])
    meshes = [Wall("mesh", mesh=joined(floor, upright))]
    planes = [PLANE, Wall("plane", axis=(1.0, 0.0, 0.0))]
    runs = [single(w, (RADIUS, 0.003, RADIUS), gravity=gravity) for w in (planes, meshes)]
    for s in runs:
        s.advance(3000)
    assert apart(*runs) < 1e-9


@pytest.mark.parametrize("mu_r", [0.0, 0.05])
def test_a_ball_in_a_faceted_tube_rolls_as_in_the_round_one(mu_r):
    # A lying tube; the ball starts 20 degrees up and rolls to and fro. 720 facets stand in for the circle.
    lying = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    radius, up = 0.2, math.radians(20.0)
    start = np.array([0.0, math.sin(up), -math.cos(up)]) * (radius - RADIUS)
    runs = []
    round_tube = Wall("cylinder", centre=(-0.5, 0.0, 0.0), axis=(1.0, 0.0, 0.0), radius=radius, length=1.0)
    for wall in (
        round_tube,
        Wall("mesh", mesh=moved(tube_mesh(radius, 1.0, 720), lying, [-0.5, 0, 0])),
    ):
        s = single([wall], start, contact=Interaction(0.5, 0.5, 0.5, mu_r))
        track = []
        for _ in range(20):
            s.advance(int(0.04 / s.dt))
            track.append(s.particles.state[0, 1])
        runs.append(np.array(track))
    assert np.abs(runs[0] - runs[1]).max() < 0.02 * np.abs(runs[0]).max()
    assert runs[0].min() < -0.01 or mu_r > 0.0


@pytest.mark.parametrize(
    "wall",
    [
        Wall("plane", name="sieve"),
        Wall("disc", radius=0.5, name="sieve"),
        Wall("mesh", mesh=plate_mesh(1.0, 10, 0.3), name="sieve"),
        # Triangles much smaller than a step: the far side is touched at another one.
        Wall("mesh", mesh=plate_mesh(0.2, 150), name="sieve"),
        Wall("cylinder", centre=(-0.5, 0, -0.3), axis=(1, 0, 0), radius=0.3, length=1.0, name="sieve"),
    ],
    ids=["plane", "disc", "mesh", "fine mesh", "tube"],
)
def test_going_through_a_wall_stops_the_run_with_names(wall):
    # At 45 m/s the ball has more energy than the spring takes over its radius: v > r sqrt(K/m) = 31 m/s.
    s = single([wall], (0.004, 0.003, 1.2 * RADIUS), (9.0, 0.0, -45.0))
    with pytest.raises(BlowUp, match=r"particle 0 went through wall 0 \(sieve\)"):
        s.advance(100)
    assert s.time < 0.002


def test_a_wobbling_ball_in_a_funnel_has_gone_through_nothing():
    # It touches the whole ring at once; the nearest side of the steep funnel changes from step to step.
    cone = Wall("cone", radius=0.015, end_radius=0.2, length=0.6)
    mesh = Wall("mesh", mesh=tube_mesh(0.015, 0.6, 48, end_radius=0.2))
    for wall in (cone, mesh):
        s = single([wall], (1e-4, 0.0, 0.1), contact=Interaction(0.3, 0.1, 0.1, 0.1))
        s.advance(int(0.5 / s.dt))
        assert 0.0 < s.particles.state[0, 2] < 0.1
        assert abs(s.particles.state[0, 6]) < 0.1


def test_where_some_may_be_squeezed_through_a_wall_the_run_goes_on_and_counts_them():
    s = single([Wall("disc", radius=0.5, name="sieve")], (0.004, 0.003, 1.2 * RADIUS), (9.0, 0.0, -45.0))
    s.may_squeeze = 0.01
    s.advance(100)
    assert s.squeezed == 1
    assert s.particles.state[0, 2] < 0.0


def test_of_many_only_so_many_may():
    """FEW_SQUEEZED may in any case; a share of .01 of 2000 would be 20."""
    wall = Wall("disc", radius=0.5, name="sieve")
    for ever, allowed in ((1, FEW_SQUEEZED), (2000, 20)):
        s = single([wall], (0.004, 0.003, 1.2 * RADIUS), (9.0, 0.0, -45.0))
        s.may_squeeze, s.next_number, s.squeezed = 0.01, ever, allowed
        with pytest.raises(BlowUp, match="went through"):
            s.advance(100)

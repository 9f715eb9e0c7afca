"""What a wall refuses, and where a moving one is."""

from __future__ import annotations

import math

import numpy as np
import pytest

from demcore.contact.model import Vec3
from demcore.errors import InputError
from demcore.geometry.mesh import TriangleMesh
from demcore.geometry.motion import (
    is_present,
    largest_step,
    next_change,
    place_walls,
    set_home,
    surface_velocity,
    to_body,
    turn_to_world,
    way_of,
)
from demcore.geometry.wall_arrays import frame, wall_arrays
from demcore.geometry.walls import Oscillation, Wall

NAN, INF = math.nan, math.inf
TRIANGLE = TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
CONE = {"kind": "cone", "radius": 0.1, "end_radius": 0.2, "length": 0.3}


@pytest.mark.parametrize(
    ("fields", "named"),
    [
        ({"kind": "sphere"}, "wall.kind"),
        ({"kind": "plane", "centre": (0, NAN, 0)}, "wall.centre"),
        ({"kind": "plane", "centre": (0, 0)}, "wall.centre"),
        ({"kind": "plane", "centre": "origin"}, "wall.centre"),
        ({"kind": "plane", "axis": (0, 0, 0)}, "wall.axis"),
        ({"kind": "plane", "axis": (0, 0, INF)}, "wall.axis"),
        ({"kind": "plane", "axis": (0, 0, 1e-200)}, "wall.axis"),
        ({"kind": "plane", "velocity": (INF, 0, 0)}, "wall.velocity"),
        ({"kind": "plane", "angular_velocity": (0, NAN, 0)}, "wall.angular_velocity"),
        ({"kind": "plane", "surface_velocity": (0, NAN, 0)}, "wall.surface_velocity"),
        ({"kind": "plane", "pivot": (0, 0, NAN)}, "wall.pivot"),
        ({"kind": "plane", "oscillation": 3.0}, "wall.oscillation"),
        ({"kind": "plane", "material": -1}, "wall.material"),
        ({"kind": "plane", "material": 0.5}, "wall.material"),
        ({"kind": "plane", "from_time": -1.0}, "wall.from_time"),
        ({"kind": "plane", "from_time": NAN}, "wall.from_time"),
        ({"kind": "plane", "from_time": 2.0, "until_time": 1.0}, "wall.until_time"),
        ({"kind": "plane", "moves_from": 2.0, "moves_until": 1.0}, "wall.moves_until"),
        ({"kind": "plane", "name": 7}, "wall.name"),
        ({"kind": "plane", "mesh": TRIANGLE}, "wall.mesh"),
        ({"kind": "plane", "inner_radius": 0.1}, "wall.inner_radius"),
        ({"kind": "disc"}, "wall.radius"),
        ({"kind": "disc", "radius": -1.0}, "wall.radius"),
        ({"kind": "disc", "radius": NAN}, "wall.radius"),
        ({"kind": "disc", "radius": 0.2, "inner_radius": 0.2}, "wall.inner_radius"),
        ({"kind": "disc", "radius": 0.2, "inner_radius": -0.1}, "wall.inner_radius"),
        ({"kind": "cylinder", "radius": 0.2}, "wall.length"),
        ({"kind": "cylinder", "radius": 0.2, "length": INF}, "wall.length"),
        ({"kind": "cylinder", "radius": 0.2, "length": 1.0, "end_radius": 0.1}, "wall.end_radius"),
        ({**CONE, "radius": 0.0, "end_radius": 0.0}, "wall.radius"),
        ({**CONE, "end_radius": -0.1}, "wall.end_radius"),
        ({**CONE, "length": 0.0}, "wall.length"),
        ({"kind": "mesh"}, "wall.mesh"),
        ({"kind": "mesh", "mesh": "hopper.stl"}, "wall.mesh"),
    ],
)
def test_a_wrong_field_is_named(fields, named):
    with pytest.raises(InputError) as caught:
        Wall(**fields)
    assert caught.value.field == named
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("fields", "named"),
    [
        ({"amplitude": (0, NAN, 0)}, "oscillation.amplitude"),
        ({"frequency": 0.0}, "oscillation.frequency"),
        ({"frequency": -1.0}, "oscillation.frequency"),
        ({"phase": INF}, "oscillation.phase"),
        ({"angle": 4.0}, "oscillation.angle"),
        ({"axis": (0, 0, 0)}, "oscillation.axis"),
    ],
)
def test_a_wrong_oscillation_is_named(fields, named):
    with pytest.raises(InputError) as caught:
        Oscillation(**fields)
    assert caught.value.field == named


def test_frames_are_rotations_and_an_upright_one_is_the_identity():
    assert (frame((0.0, 0.0, 2.0)) == np.eye(3)).all()
    for axis in ((1, 0, 0), (0, -1, 0), (0, 0, -1), (1, 2, -3), (1, 1e-9, 0)):
        f = frame(axis)
        assert np.abs(f.T @ f - np.eye(3)).max() < 1e-15
        assert np.linalg.det(f) == pytest.approx(1.0)
        assert f[:, 2] == pytest.approx(np.array(axis) / np.linalg.norm(axis))


SWING = Oscillation((0.1, 0.0, -0.2), 1.5, 0.3, 0.6, (0.0, 2.0, 1.0))
BODY = {"centre": (1.0, 2.0, 0.5), "axis": (0.0, 1.0, 1.0), "radius": 0.4}


def points_of(walls, w=0):
    """World positions of a few points of the body."""
    fixed = np.random.default_rng(2).uniform(-0.4, 0.4, (8, 3))
    return np.array([walls.pose[w, :3] + turn_to_world(walls.pose, w, Vec3(*p)) for p in fixed])


def placed(wall, time, dt=0.0):
    walls = wall_arrays([wall])
    place_walls(walls, time, dt)
    return walls


def test_a_turn_about_a_pivot_is_the_rigid_one():
    # By hand: a quarter turn about z through (1, 0, 0), which travels with (0, 0, 3) m/s meanwhile.
    wall = Wall("disc", **BODY, pivot=(1.0, 0.0, 0.0), angular_velocity=(0, 0, math.pi), velocity=(0, 0, 3.0))
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    before, after = points_of(placed(wall, 0.0)), points_of(placed(wall, 0.5))
    pivot = np.array([1.0, 0, 0])
    assert np.abs(after - ((before - pivot) @ quarter.T + pivot + [0, 0, 1.5])).max() < 1e-14


def test_an_oscillation_is_a_sine_about_the_place():
    wall = Wall("disc", **BODY, oscillation=Oscillation((0.1, 0.0, -0.2), 1.5, 0.3))
    for time in (0.0, 0.1, 7.7):
        s = math.sin(2 * math.pi * 1.5 * time + 0.3)
        assert placed(wall, time).pose[0, :3] == pytest.approx([1 + 0.1 * s, 2.0, 0.5 - 0.2 * s], abs=1e-14)


@pytest.mark.parametrize("time", [0.05, 0.4, 2.0])
def test_the_surface_moves_as_the_body_does(time):
    # Central difference over the positions of body points half a step before.
    wall = Wall("disc", **BODY, pivot=(0.5, 1.0, 0.0), velocity=(0.3, -0.1, 0.2),
                angular_velocity=(1.0, -2.0, 0.5), oscillation=SWING)  # fmt: skip
    h = 1e-5
    earlier, later = points_of(placed(wall, time - h)), points_of(placed(wall, time + h))
    now = placed(wall, time, 0.0)
    for p, velocity in zip(points_of(now), (later - earlier) / (2 * h), strict=True):
        found = surface_velocity(now.pose, now.shape, 0, *p, Vec3(0.0, 0.0, 1.0))
        assert np.array(found) == pytest.approx(velocity, abs=1e-7)


def test_motion_has_a_beginning_and_an_end():
    wall = Wall("disc", **BODY, velocity=(1.0, 0, 0), moves_from=0.25, moves_until=0.75)
    for time, x, speed in (
        (0.0, 1.0, 0.0),
        (0.2, 1.0, 0.0),
        (0.5, 1.25, 1.0),
        (0.75, 1.5, 1.0),
        (5.0, 1.5, 0.0),
    ):
        walls = placed(wall, time, 0.01)
        assert walls.pose[0, 0] == pytest.approx(x, abs=1e-15)
        assert surface_velocity(walls.pose, walls.shape, 0, 0.0, 0.0, 0.0, Vec3(0.0, 0.0, 1.0)).x == speed


def test_body_and_world_are_inverse():
    walls = placed(Wall("disc", **BODY, angular_velocity=(1, 2, 3), oscillation=SWING), 0.7)
    q = to_body(walls.pose, 0, 0.3, -0.2, 1.1)
    back = walls.pose[0, :3] + turn_to_world(walls.pose, 0, q)
    assert back == pytest.approx([0.3, -0.2, 1.1], abs=1e-15)


@pytest.mark.parametrize(
    "wall",
    [
        Wall("disc", **BODY, angular_velocity=(3.0, 0, 1.0), velocity=(0.1, 0, 0)),
        Wall("disc", **BODY, oscillation=SWING, pivot=(0, 0, 0)),
        Wall("plane", centre=(0, 0, 1), angular_velocity=(0.5, 0, 0), pivot=(0, 3, 0)),
        Wall("mesh", mesh=TRIANGLE, angular_velocity=(0, 5.0, 0), pivot=(0.2, 0, 0)),
    ],
)
def test_the_way_since_the_last_search_bounds_every_point(wall):
    # Points of the surface near the particles: none may travel farther than the bound says.
    skin, dt = 0.05, 1e-3
    walls = wall_arrays([wall])
    fixed = np.random.default_rng(2).uniform(-1, 1, (300, 3))
    if wall.kind == "plane":
        fixed[:, 2] = 0.0
        fixed[:, :2] *= 8.0
    elif wall.kind == "disc":
        fixed = fixed * [0.28, 0.28, 0.0]
    else:
        fixed = np.column_stack([np.abs(fixed[:, :2]) / 2, np.zeros(300)])
    home = np.array([walls.pose[0, :3] + turn_to_world(walls.pose, 0, Vec3(*p)) for p in fixed])
    particles = np.zeros((4, 12))
    particles[:, :3], particles[:, 3] = home[:4] + 0.05, 0.1
    set_home(walls, particles, particles[:, 3] + skin)
    # Those that can touch one of the particles before the list is stale.
    gap = np.sqrt(((home[:, None] - particles[None, :, :3]) ** 2).sum(axis=2)).min(axis=1)
    matter = gap < 0.1 + skin
    assert matter.any()
    tight = []
    for step in range(1, 30):
        place_walls(walls, step * dt, dt)
        now = np.array([walls.pose[0, :3] + turn_to_world(walls.pose, 0, Vec3(*p)) for p in fixed])
        gone = np.sqrt(((now - home) ** 2).sum(axis=1))[matter].max()
        assert gone <= way_of(walls, 0) * (1 + 1e-12)
        assert way_of(walls, 0) <= step * largest_step(walls, 0, dt) * (1 + 1e-9)
        tight.append(gone / way_of(walls, 0))
    assert max(tight) > 0.1


def test_what_turns_in_place_has_no_way_to_go():
    particles = np.zeros((1, 12))
    for wall in (
        Wall("cylinder", **BODY, length=1.0, angular_velocity=(0, 5.0, 5.0)),
        Wall("plane", axis=(1, 0, 0), angular_velocity=(9.0, 0, 0), pivot=(0, 4.0, 0)),
    ):
        walls = wall_arrays([wall])
        set_home(walls, particles, particles[:, 3] + 0.1)
        place_walls(walls, 0.3, 1e-3)
        assert way_of(walls, 0) < 1e-15


def test_times_of_a_wall_become_steps():
    walls = wall_arrays([Wall("plane", from_time=0.3, until_time=0.7), Wall("plane")])
    dt = 0.1  # 3 dt is not 0.3 in binary
    assert [is_present(walls, 0, n, dt) for n in range(9)] == [n in (3, 4, 5, 6) for n in range(9)]
    assert all(is_present(walls, 1, n, dt) for n in (0, 10**9))
    assert [next_change(walls, n, dt) for n in (0, 2, 3, 6, 7)] == [3, 3, 7, 7, INF]


def test_a_belt_is_projected_on_the_face_and_keeps_its_speed():
    walls = wall_arrays([Wall("plane", axis=(0, 1, 1), surface_velocity=(0.0, 3.0, 0.0))])
    n = Vec3(0.0, math.sqrt(0.5), math.sqrt(0.5))
    found = surface_velocity(walls.pose, walls.shape, 0, 5.0, 1.0, 2.0, n)
    assert tuple(found) == pytest.approx((0.0, 3 * math.sqrt(0.5), -3 * math.sqrt(0.5)))
    assert tuple(surface_velocity(walls.pose, walls.shape, 0, 0.0, 0.0, 0.0, Vec3(0.0, -1.0, 0.0))) == (
        0.0,
        0.0,
        0.0,
    )

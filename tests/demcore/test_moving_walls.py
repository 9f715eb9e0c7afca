"""Walls that travel, turn, swing, run as belts, appear and vanish: closed forms, and no contact ever missed."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from demcore.case import Interaction
from demcore.errors import BlowUp
from demcore.geometry.wall_arrays import replace_wall
from demcore.geometry.walls import Oscillation, Wall
from demcore.particles import Particles
from demcore.simulation import Simulation
from demcore.wall_forces import wall_distance
from tests.demcore.wall_builders import (
    CONTACT,
    RADIUS,
    G,
    moved,
    plate_mesh,
    resting_overlap,
    single,
    tube_mesh,
)

REST = RADIUS - resting_overlap()
FREE = Interaction(0.5, 0.0, 0.0, 0.0)
GRIP = Interaction(0.5, 0.8, 0.8, 0.0)
PLATE = plate_mesh(1.0, 20, 0.3)


def row(s, *columns):
    return [float(s.particles.state[0, c]) for c in columns]


@pytest.mark.parametrize("shape", [{"kind": "plane"}, {"kind": "mesh", "mesh": PLATE}])
def test_a_plate_that_goes_up_and_down_carries_its_ball(shape):
    # Below A (2 pi f)^2 = g the ball follows the plate; it starts at the top of the swing, at rest.
    amplitude, frequency = 0.004, 5.0
    plate = Wall(**shape, oscillation=Oscillation((0.0, 0.0, amplitude), frequency, math.pi / 2))
    s = single([plate], (0.01, 0.02, REST + amplitude))
    for _ in range(40):
        s.advance(int(0.01 / s.dt))
        expected = REST + amplitude * math.cos(2 * math.pi * frequency * s.time)
        assert row(s, 2)[0] == pytest.approx(expected, abs=0.01 * amplitude)


@pytest.mark.parametrize("shape", [{"kind": "plane"}, {"kind": "mesh", "mesh": PLATE}])
def test_a_plate_that_goes_to_and_fro_rolls_its_ball_two_sevenths_of_the_way(shape):
    # Rolling without slip on an accelerated plate: m a = F, I w' = -F R, so a = (2/7) a_plate.
    amplitude, frequency = 0.01, 2.0
    plate = Wall(**shape, oscillation=Oscillation((amplitude, 0.0, 0.0), frequency, math.pi / 2))
    s = single([plate], (0.0, 0.003, REST), contact=GRIP)
    for _ in range(25):
        s.advance(int(0.02 / s.dt))
        expected = 2 / 7 * amplitude * (math.cos(2 * math.pi * frequency * s.time) - 1.0)
        assert row(s, 0)[0] == pytest.approx(expected, abs=0.01 * amplitude)


def test_a_swinging_tray_holds_what_its_pose_says():
    # A frictionless ball in the corner of two planes that swing about a far pivot: it keeps its place in the
    # frame of the tray, because the swing is slow. Expected: the rigid turn of the start position.
    pivot, angle, frequency = np.array([0.0, 0.0, 1.0]), 0.2, 0.5
    swing = Oscillation(frequency=frequency, phase=math.pi / 2, angle=angle, axis=(0.0, 1.0, 0.0))

    def turned(time):
        th = angle * math.cos(2 * math.pi * frequency * time)
        return np.array([[math.cos(th), 0, math.sin(th)], [0, 1, 0], [-math.sin(th), 0, math.cos(th)]])

    walls = [
        Wall("plane", axis=axis, pivot=tuple(pivot), oscillation=swing)
        for axis in ((0.5, 0.0, 1.0), (-0.5, 0.0, 1.0))
    ]
    place = np.array([0.0, 0.0, RADIUS * math.sqrt(1.25)]) - pivot
    s = single(walls, pivot + turned(0.0) @ place, contact=Interaction(0.3, 0.0, 0.0, 0.0))
    for _ in range(20):
        s.advance(int(0.05 / s.dt))
        expected = pivot + turned(s.time) @ place
        assert np.abs(s.particles.state[0, :3] - expected).max() < 0.02 * RADIUS


@pytest.mark.parametrize("mesh", [False, True])
def test_a_turning_drum_spins_its_ball_up(mesh):
    # Rolling without slip: at the contact the ball's surface moves as the drum's, Omega x c; it is driven round
    # at W R / r, less what it still swings up and down.
    radius, rate = 0.15, 4.0
    lying = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    drum = Wall("cylinder", centre=(-0.2, 0, 0), axis=(1, 0, 0), radius=radius, length=0.4,
                angular_velocity=(rate, 0, 0))  # fmt: skip
    if mesh:
        drum = Wall("mesh", mesh=moved(tube_mesh(radius, 0.4, 360), lying, [-0.2, 0, 0]),
                    angular_velocity=(rate, 0, 0))  # fmt: skip
    s = single([drum], (0.01, 0.0, RADIUS - radius), contact=Interaction(0.2, 0.3, 0.3, 0.0))
    s.advance(int(0.8 / s.dt))
    x, v, w = (s.particles.state[0, c : c + 3] for c in (0, 4, 8))
    outwards = np.array([0.0, x[1], x[2]]) / math.hypot(x[1], x[2])
    surface = v + np.cross(w, RADIUS * outwards)
    assert surface == pytest.approx(np.cross([rate, 0, 0], radius * outwards), abs=0.02 * rate * radius)
    assert w[0] > 0.6 * rate * radius / RADIUS


def test_a_turning_paddle_drives_a_ball_outwards():
    # Bead on a turning rod, all frictionless, with its centre a radius before the paddle: along the paddle
    # s'' = w^2 s, so s = s0 cosh(w t) when it starts with the paddle's own motion.
    rate, s0 = 3.0, 0.1
    upright = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
    paddle = Wall(
        "mesh", mesh=moved(plate_mesh(1.0, 12), upright, np.zeros(3)), angular_velocity=(0, 0, rate)
    )
    s = single([Wall("plane"), paddle], (s0, RADIUS, REST), (-rate * RADIUS, rate * s0, 0.0), contact=FREE)
    s.advance(int(0.4 / s.dt))
    angle = rate * s.time
    x, y = row(s, 0, 1)
    along, ahead = x * math.cos(angle) + y * math.sin(angle), -x * math.sin(angle) + y * math.cos(angle)
    assert along == pytest.approx(s0 * math.cosh(angle), rel=0.01)
    assert ahead == pytest.approx(RADIUS, rel=0.01)


def test_a_lifted_tube_lets_its_ball_out_from_underneath():
    tube = Wall("cylinder", radius=0.1, length=0.3, velocity=(0, 0, 0.2), moves_from=0.3)
    s = single([Wall("plane"), tube], (0.0, 0.0, REST), (0.5, 0.0, 0.0), contact=Interaction(0.9, 0, 0, 0))
    s.advance(int(0.3 / s.dt))
    farthest = 0.0
    while s.time < 0.35:
        s.advance(20)
        farthest = max(farthest, abs(row(s, 0)[0]))
    assert farthest < 0.1 - 0.95 * RADIUS
    s.advance(int(0.5 / s.dt))
    assert abs(row(s, 0)[0]) > 0.12
    # The pose is a closed form: after t it stands at v (t - 0.3), no sum of steps.
    assert s.walls.pose[1, 2] == 0.2 * (s.step * s.dt - 0.3)


@pytest.mark.parametrize("tilted", [False, True])
def test_a_belt_in_triangles_drives_a_free_ball_to_two_sevenths(tilted):
    # physics.md section 3. Tilted: the belt vector is level, the face climbs by 10 degrees; it is projected
    # on the face and brought back to 1.79 m/s. Gravity is square to the face.
    v, th = 1.79, math.radians(10.0) if tilted else 0.0
    turn = np.array([[math.cos(th), 0, -math.sin(th)], [0, 1, 0], [math.sin(th), 0, math.cos(th)]])
    belt = Wall("mesh", mesh=moved(plate_mesh(3.0, 60, 0.3), turn, np.zeros(3)), surface_velocity=(v, 0, 0))
    s = single([belt], turn @ [0.0, 0.0, REST], contact=Interaction(0.2, 0.5, 0.45, 0.0),
               gravity=turn @ [0, 0, -G])  # fmt: skip
    s.advance(int(0.5 / s.dt))
    along = s.particles.state[0, 4:7] @ turn[:, 0]
    assert along == pytest.approx(2 / 7 * v, rel=0.01)
    assert row(s, 9)[0] == pytest.approx(-5 / 7 * v / RADIUS, rel=0.01)


def test_a_belt_stands_where_nothing_of_it_lies_in_the_face():
    # A wall square to the belt: a ball that slides down along it is not driven sideways.
    belt = Wall("plane", axis=(1.0, 0.0, 0.0), surface_velocity=(2.0, 0.0, 0.0))
    s = single([belt], (REST, 0.0, 0.0), gravity=(-G, 0.0, 0.0))
    s.advance(500)
    assert row(s, 5, 6) == [0.0, 0.0]


RESTLESS = [
    Wall("plane", centre=(0, 0, -0.25), velocity=(0, 0, 0.15)),
    Wall("plane", centre=(0, 0, 0.24), axis=(0.1, 0, -1), angular_velocity=(0.0, 0.8, 0.1)),
    Wall("disc", radius=0.3, inner_radius=0.1, axis=(1, 0, 0), angular_velocity=(0, 2.0, 1.0)),
    Wall("cone", centre=(0.1, 0, 0), radius=0.05, end_radius=0.2, length=0.2, pivot=(0, 0.1, 0),
         oscillation=Oscillation((0.02, 0.0, 0.03), 3.0, 0.4, 0.5, (1, 1, 0))),
    Wall("mesh", mesh=plate_mesh(0.4, 8, 0.3), centre=(0, 0.1, 0), angular_velocity=(1.0, 1.0, 0.0),
         pivot=(0.3, 0, 0), velocity=(0.0, -0.1, 0.0), moves_from=0.1, moves_until=0.5),
]  # fmt: skip


@pytest.mark.parametrize("wall", RESTLESS, ids=["travel", "tilt", "spin", "swing", "mesh"])
def test_no_wall_ever_meets_a_ball_that_the_list_has_not(wall):
    # A cloud at rest in the way of a wall, without gravity; after every step each overlap must be in the list.
    rng = np.random.default_rng(11)
    grid = np.stack(np.meshgrid(*[np.linspace(-0.2, 0.2, 5)] * 3), axis=-1).reshape(-1, 3)
    start = grid + rng.uniform(-0.01, 0.01, grid.shape)
    alone = single([wall], start, gravity=(0, 0, 0))
    clear = [i for i, q in enumerate(start) if distance(alone.walls, q) > RADIUS * 1.001]
    s = single([wall], start[clear], gravity=(0, 0, 0))
    met = set()
    for _ in range(700):
        s.advance(10)
        near = s.near_walls
        for i, q in enumerate(s.particles.state[:, :3]):
            if distance(s.walls, q) < RADIUS and not s.stale:
                met.add(int(s.particles.number[i]))
                assert i in near.owner
    assert len(met) > 5


def distance(walls, q):
    """Of a point to the only wall there is; for a mesh by brute force over all of its triangles."""
    if len(walls.triangle) == 0:
        return wall_distance(walls.kind[0], walls.shape, walls.pose, 0, *q)[0]
    turn, centre = walls.pose[0, 3:12].reshape(3, 3), walls.pose[0, :3]
    p = turn.T @ (q - centre)
    # The mesh is a plate at z = 0 of 0.4 m: its distance is that of a square.
    out = np.maximum(np.abs(p[:2]) - 0.2, 0.0)
    return math.sqrt(p[2] ** 2 + out @ out)


def test_a_wall_appears_and_vanishes_at_its_step():
    # Free fall, then a floor that is gone again: velocities between are those of n steps of gravity, exactly.
    start, stop = 0.05, 0.5
    floor = Wall("mesh", mesh=PLATE, centre=(0, 0, -0.1), from_time=start, until_time=stop)
    s = single([Wall("plane", until_time=0.02), floor], (0.0, 0.0, REST))
    leaves, ends = (math.ceil(t / s.dt) for t in (0.02, stop))
    s.advance(leaves)
    resting = row(s, 6)[0]
    assert abs(resting) < 1e-6
    s.advance(100)
    fallen = resting
    for _ in range(100):
        fallen += -G * s.dt
    assert row(s, 6)[0] == fallen
    s.advance(ends - s.step)
    assert row(s, 2)[0] == pytest.approx(REST - 0.1, abs=0.1 * RADIUS)
    before = row(s, 6)[0]
    s.advance(3)
    assert row(s, 6)[0] == ((before - G * s.dt) - G * s.dt) - G * s.dt


def test_a_wall_does_not_appear_inside_a_ball():
    trap = Wall("disc", radius=0.3, from_time=0.05, name="trap")
    s = single([trap], (0.0, 0.0, 0.001), gravity=(0, 0, 0))
    s.advance(int(0.049 / s.dt))
    with pytest.raises(BlowUp, match=r"particle 0 is where wall 0 \(trap\) appears"):
        s.advance(100)
    # What rested on another wall at the same place may stay.
    pair = [Wall("plane", until_time=0.05), Wall("disc", radius=0.3, from_time=0.05)]
    s = single(pair, (0.0, 0.0, REST))
    s.advance(int(0.1 / s.dt))
    assert row(s, 2)[0] == pytest.approx(REST, rel=1e-3)


def test_a_wall_too_fast_to_be_met_stops_the_run():
    s = single(
        [Wall("disc", radius=0.3, centre=(0, 0, -1.0), velocity=(0, 0, 1e4), name="shot")], (0, 0, 0.0)
    )
    with pytest.raises(BlowUp, match=r"wall 0 \(shot\) moves more than half"):
        s.advance(10)


def a_busy_case(threaded=False):
    """Balls over a belt mesh that shakes, a paddle that turns, a floor that vanishes."""
    rng = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(*[np.arange(6) * 2.2 * RADIUS] * 2, np.arange(3) * 2.2 * RADIUS), axis=-1)
    start = grid.reshape(-1, 3) - [0.11, 0.11, -1.5 * RADIUS] + rng.uniform(-1e-3, 1e-3, (108, 3))
    walls = [
        Wall("mesh", mesh=plate_mesh(0.6, 15, 0.3), surface_velocity=(0.5, 0, 0),
             oscillation=Oscillation((0.0, 0.0, 1e-3), 20.0)),
        Wall("disc", radius=0.1, centre=(0.3, 0, 0.05), axis=(1, 0, 0), angular_velocity=(0, 3.0, 0)),
        Wall("plane", centre=(0, -0.16, 0), axis=(0, 1, 0), until_time=0.11),
        Wall("cylinder", centre=(0, 0, 0), radius=0.35, length=1.0, from_time=0.07),
    ]  # fmt: skip
    return single(walls, start, threaded=threaded)


def bits(s):
    return s.particles.state[np.argsort(s.particles.number)].tobytes()


def restarted(s):
    """The simulation again from copies of its arrays, as a checkpoint keeps them, poses left out."""
    fresh = a_busy_case()
    fresh.particles = Particles(*(a.copy() for a in s.particles))
    fresh.neighbours = type(s.neighbours)(*(a.copy() for a in s.neighbours))
    fresh.near_walls = type(s.near_walls)(*(a.copy() for a in s.near_walls))
    fresh.walls = fresh.walls._replace(home=s.walls.home.copy())
    fresh.step, fresh.stale = s.step, s.stale
    return fresh


def test_same_bits_in_pieces_on_threads_and_after_a_restart():
    whole = a_busy_case()
    whole.advance(3000)
    pieces = a_busy_case()
    for steps in (1, 16, 483, 500, 777, 1223):
        pieces.advance(steps)
        pieces = restarted(pieces)
    threaded = a_busy_case(threaded=True)
    threaded.advance(3000)
    assert isinstance(pieces, Simulation)
    assert pieces.step == threaded.step == 3000
    assert len(threaded.neighbours.slab_start) > 2
    assert bits(whole) == bits(pieces)
    assert bits(whole) == bits(threaded)
    # It was no quiet case: walls moved, appeared and vanished, balls were driven.
    assert whole.time > 0.12
    assert np.abs(whole.particles.state[:, 4]).max() > 0.1


def test_a_wall_may_be_given_another_motion():
    # At rest on a plate that starts to rise on command: history and place are kept, then it is carried.
    plate = Wall("mesh", mesh=PLATE)
    s = single([plate], (0.0, 0.0, REST), contact=CONTACT)
    s.advance(1000)
    rising = Wall("mesh", mesh=PLATE, velocity=(0.0, 0.0, 0.1), moves_from=s.time)
    replace_wall(s.walls, 0, rising, s.time)
    s.stale = True
    began = s.time
    s.advance(2000)
    assert row(s, 2)[0] == pytest.approx(REST + 0.1 * (s.time - began), abs=0.01 * RADIUS)
    assert all(a >= b for a, b in itertools.pairwise([row(s, 6)[0], 0.0]))

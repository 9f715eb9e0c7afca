"""Where every wall is at a time, how its surface moves there, and how far it went since the last search.

A pose is a closed form of the time, never a sum over steps, so a restart finds the same bits. With t the time
since the motion began and s = sin(2 pi f t + phase):
  pivot(t) = pivot + velocity t + amplitude s
  rotation(t) = turn(axis, angle s) turn(angular velocity, t) rotation
Velocities are those of half a step ago, when the particles have theirs (semi-implicit Euler).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.contact.model import Vec3
from demcore.geometry.wall_rows import (
    AMPLITUDE,
    ANGLE,
    AXIS,
    BELT,
    BELT_SPEED,
    CENTRE,
    EXTENT,
    FREQUENCY,
    HOME_PIVOT,
    HOME_TURN,
    MOVES,
    OFFSET,
    PHASE,
    PIVOT,
    PIVOT_NOW,
    REACH,
    ROTATION,
    SPIN,
    SPIN_NOW,
    TURN,
    VELOCITY,
    VELOCITY_NOW,
    Floats,
    Walls,
)
from demcore.jit import kernel, leaf

TWO_PI = 2.0 * math.pi
# Where less than this share of a belt's direction lies in the face, the face does not run.
LEAST_BELT_SHARE = 1e-6
# Times of a case are multiples of the step only to rounding.
STEP_SLACK = 1e-6


class Rotation(NamedTuple):
    """Nine numbers, row by row."""

    xx: float
    xy: float
    xz: float
    yx: float
    yy: float
    yz: float
    zx: float
    zy: float
    zz: float


@leaf
def turn_about(x: float, y: float, z: float, angle: float) -> Rotation:
    """Rodrigues' rotation by `angle`, rad, about (x, y, z), which need not be of length one."""
    size = math.sqrt(x * x + y * y + z * z)
    if size == 0.0 or angle == 0.0:
        return Rotation(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    x, y, z = x / size, y / size, z / size
    s, half = math.sin(angle), math.sin(0.5 * angle)
    # 1 - cos without cancellation.
    u = 2.0 * half * half
    return Rotation(
        1.0 - u * (y * y + z * z), u * x * y - s * z, u * x * z + s * y,
        u * x * y + s * z, 1.0 - u * (x * x + z * z), u * y * z - s * x,
        u * x * z - s * y, u * y * z + s * x, 1.0 - u * (x * x + y * y),
    )  # fmt: skip


@leaf
def rotate(r: Rotation, v: Vec3) -> Vec3:
    return Vec3(
        r.xx * v.x + r.xy * v.y + r.xz * v.z,
        r.yx * v.x + r.yy * v.y + r.yz * v.z,
        r.zx * v.x + r.zy * v.y + r.zz * v.z,
    )


@leaf
def vector_at(rows: Floats, w: int, c: int) -> Vec3:
    return Vec3(rows[w, c], rows[w, c + 1], rows[w, c + 2])


@leaf
def time_moving(walls: Walls, w: int, time: float) -> float:
    """How long wall w has been moving at `time`, s."""
    begin, end = walls.motion[w, MOVES], walls.motion[w, MOVES + 1]
    return float(min(max(time, begin), end) - begin)


@leaf
def place_wall(walls: Walls, w: int, time: float, dt: float) -> None:
    """Write the pose of wall w at `time` and its velocities at time - dt/2."""
    m, rest, pose = walls.motion, walls.rest, walls.pose
    t = time_moving(walls, w, time)
    s = math.sin(TWO_PI * m[w, FREQUENCY] * t + m[w, PHASE])
    swing = turn_about(m[w, AXIS], m[w, AXIS + 1], m[w, AXIS + 2], m[w, ANGLE] * s)
    spin = vector_at(m, w, SPIN)
    rate = math.sqrt(spin.x * spin.x + spin.y * spin.y + spin.z * spin.z)
    turned = turn_about(spin.x, spin.y, spin.z, rate * t)
    for c in range(3):
        column = rotate(
            swing,
            rotate(turned, Vec3(rest[w, ROTATION + c], rest[w, ROTATION + 3 + c], rest[w, ROTATION + 6 + c])),
        )
        pose[w, TURN + c], pose[w, TURN + 3 + c], pose[w, TURN + 6 + c] = column.x, column.y, column.z
        pose[w, PIVOT_NOW + c] = rest[w, PIVOT + c] + m[w, VELOCITY + c] * t + m[w, AMPLITUDE + c] * s
    arm = rotate(swing, rotate(turned, vector_at(rest, w, OFFSET)))
    pose[w, CENTRE] = pose[w, PIVOT_NOW] + arm.x
    pose[w, CENTRE + 1] = pose[w, PIVOT_NOW + 1] + arm.y
    pose[w, CENTRE + 2] = pose[w, PIVOT_NOW + 2] + arm.z
    # The first step of a motion has no half step before it.
    before = max(time - 0.5 * dt, m[w, MOVES])
    moves = 1.0 if m[w, MOVES] <= time and before < m[w, MOVES + 1] else 0.0
    t = time_moving(walls, w, before)
    rise = TWO_PI * m[w, FREQUENCY] * math.cos(TWO_PI * m[w, FREQUENCY] * t + m[w, PHASE])
    swung = rotate(swing, spin)
    for c in range(3):
        pose[w, VELOCITY_NOW + c] = moves * (m[w, VELOCITY + c] + m[w, AMPLITUDE + c] * rise)
    pose[w, SPIN_NOW] = moves * (swung.x + m[w, AXIS] * m[w, ANGLE] * rise)
    pose[w, SPIN_NOW + 1] = moves * (swung.y + m[w, AXIS + 1] * m[w, ANGLE] * rise)
    pose[w, SPIN_NOW + 2] = moves * (swung.z + m[w, AXIS + 2] * m[w, ANGLE] * rise)


@leaf
def stands(walls: Walls, w: int) -> bool:
    """True for a wall that never moves; a belt moves its surface only."""
    for c in range(AMPLITUDE + 3):
        if walls.motion[w, c] != 0.0:
            return False
    return bool(walls.motion[w, ANGLE] == 0.0)


@leaf
def way_of(walls: Walls, w: int) -> float:
    """Bound of how far a point of wall w that matters went since the last search, m.

    A turn by th moves a point at the distance a from the axis by 2 a sin(th / 2), and 2 sin(th / 2) is the
    Frobenius norm of the change of the rotation matrix over sqrt 2.
    """
    travelled = turned = 0.0
    for c in range(3):
        step = walls.pose[w, PIVOT_NOW + c] - walls.home[w, HOME_PIVOT + c]
        travelled += step * step
    for c in range(9):
        step = walls.pose[w, TURN + c] - walls.home[w, HOME_TURN + c]
        turned += step * step
    way = math.sqrt(travelled)
    if turned > 0.0 and walls.home[w, REACH] > 0.0:
        way += math.sqrt(0.5 * turned) * walls.home[w, REACH]
    return way


@kernel
def place_walls(walls: Walls, time: float, dt: float) -> float:
    """Put the walls that move where they are at `time`; the longest way of one since the last search, m."""
    longest = 0.0
    for w in range(len(walls.kind)):
        if not stands(walls, w):
            place_wall(walls, w, time, dt)
            longest = max(longest, way_of(walls, w))
    return longest


@kernel
def place_all(walls: Walls, time: float) -> None:
    """Put all walls where they are at `time`, those that never move too: needed once for new rows."""
    for w in range(len(walls.kind)):
        place_wall(walls, w, time, 0.0)


@kernel
def set_home(walls: Walls, state: Floats, reaches: Floats) -> None:
    """Remember the poses of a search, and how far from each pivot a particle can meet the wall before the next.

    A wall point that touches a particle before the list is stale is within |x - pivot| + reach of the pivot, both
    taken now: its reach (N,), m, holds its radius and what particle and wall may go until then.
    """
    for w in range(len(walls.kind)):
        for c in range(3):
            walls.home[w, HOME_PIVOT + c] = walls.pose[w, PIVOT_NOW + c]
        for c in range(9):
            walls.home[w, HOME_TURN + c] = walls.pose[w, TURN + c]
        reach = 0.0
        if walls.shape[w, EXTENT] > 0.0:
            for i in range(len(state)):
                squared = 0.0
                for c in range(3):
                    away = state[i, c] - walls.pose[w, PIVOT_NOW + c]
                    squared += away * away
                reach = max(reach, math.sqrt(squared) + reaches[i])
        walls.home[w, REACH] = min(reach, walls.shape[w, EXTENT])


@leaf
def to_body(pose: Floats, w: int, x: float, y: float, z: float) -> Vec3:
    """A point of the world in the frame of wall w."""
    p = pose
    x, y, z = x - p[w, 0], y - p[w, 1], z - p[w, 2]
    return Vec3(
        p[w, 3] * x + p[w, 6] * y + p[w, 9] * z,
        p[w, 4] * x + p[w, 7] * y + p[w, 10] * z,
        p[w, 5] * x + p[w, 8] * y + p[w, 11] * z,
    )


@leaf
def turn_to_world(pose: Floats, w: int, v: Vec3) -> Vec3:
    """A direction of the frame of wall w in the world."""
    p = pose
    return Vec3(
        p[w, 3] * v.x + p[w, 4] * v.y + p[w, 5] * v.z,
        p[w, 6] * v.x + p[w, 7] * v.y + p[w, 8] * v.z,
        p[w, 9] * v.x + p[w, 10] * v.y + p[w, 11] * v.z,
    )


@leaf
def surface_velocity(pose: Floats, shape: Floats, w: int, x: float, y: float, z: float, n: Vec3) -> Vec3:
    """Velocity of the surface of wall w at a point of the world with the normal n: travel, turn and belt, m/s."""
    p = pose
    qx, qy, qz = x - p[w, PIVOT_NOW], y - p[w, PIVOT_NOW + 1], z - p[w, PIVOT_NOW + 2]
    sx, sy, sz = p[w, SPIN_NOW], p[w, SPIN_NOW + 1], p[w, SPIN_NOW + 2]
    vx = p[w, VELOCITY_NOW] + sy * qz - sz * qy
    vy = p[w, VELOCITY_NOW + 1] + sz * qx - sx * qz
    vz = p[w, VELOCITY_NOW + 2] + sx * qy - sy * qx
    speed = shape[w, BELT_SPEED]
    if speed > 0.0:
        b = turn_to_world(pose, w, vector_at(shape, w, BELT))
        along = b.x * n.x + b.y * n.y + b.z * n.z
        bx, by, bz = b.x - along * n.x, b.y - along * n.y, b.z - along * n.z
        share = math.sqrt(bx * bx + by * by + bz * bz)
        if share > LEAST_BELT_SHARE:
            scale = speed / share
            vx, vy, vz = vx + scale * bx, vy + scale * by, vz + scale * bz
    return Vec3(vx, vy, vz)


@leaf
def first_step(time: float, dt: float) -> float:
    """Number of the first step at or after `time`; as a float, because it may be infinite."""
    return float(np.ceil(time / dt - STEP_SLACK))


@leaf
def is_present(walls: Walls, w: int, step: int, dt: float) -> bool:
    """True while wall w is there."""
    return first_step(walls.window[w, 0], dt) <= step < first_step(walls.window[w, 1], dt)


def next_change(walls: Walls, step: int, dt: float) -> float:
    """The first step after `step` at which a wall appears or vanishes; inf when none will."""
    with np.errstate(invalid="ignore"):
        steps: NDArray[np.float64] = np.ceil(walls.window / dt - STEP_SLACK)
    return float(steps[steps > step].min(initial=np.inf))


def largest_step(walls: Walls, w: int, dt: float) -> float:
    """Bound of how far a point of wall w that mattered at the last search goes in one step, m."""
    m = walls.motion[w]
    swing = TWO_PI * m[FREQUENCY]
    travel = math.hypot(*m[VELOCITY : VELOCITY + 3]) + swing * math.hypot(*m[AMPLITUDE : AMPLITUDE + 3])
    turn = math.hypot(*m[SPIN : SPIN + 3]) + swing * abs(m[ANGLE])
    arm = float(walls.home[w, REACH])
    return float((travel + (turn * arm if arm > 0.0 else 0.0)) * dt)

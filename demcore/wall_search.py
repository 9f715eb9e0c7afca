"""The search for walls near particles, with the histories of those that touched before, and what it refuses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.geometry.motion import first_step, is_present, largest_step, set_home, stands, to_body
from demcore.geometry.surfaces import triangle_distance
from demcore.geometry.triangle_tree import LEAF, following, next_leaf
from demcore.geometry.wall_rows import BELT_SPEED, TRIANGLES, Walls
from demcore.jit import kernel, leaf
from demcore.particles import Floats, Particles
from demcore.wall_forces import wall_distance
from demcore.wall_list import HIT_WIDTH, WallList
from demcore.wrench import HISTORY_WIDTH, OVERLAP

Integers = NDArray[np.int64]

# Share of the radius: a longer step may carry a centre through a wall that it never touched.
LONGEST_STEP = 0.5
# Share of the radius by which a wall that appears may overlap what lies there (a bed that rested on another).
LARGEST_FIRST_OVERLAP = 0.05
LARGEST_SETTLED_OVERLAP = 0.5
CLEAR_SLACK = 1.0 - 1e-9


@leaf
def with_room(slots: Integers, total: int) -> Integers:
    """The rows, in an array of twice the length when they are full."""
    if total < len(slots):
        return slots
    longer = np.empty((2 * len(slots), 3), np.int64)
    longer[:total] = slots
    return longer


@kernel
def collect_slots(state: Floats, reaches: Floats, walls: Walls, step: int, dt: float) -> Integers:
    """(K, 3) rows particle, wall, triangle (-1: analytic) of all that is within reach (N,), in that order."""
    slots = np.empty((256, 3), np.int64)
    total = 0
    present = [is_present(walls, w, step, dt) for w in range(len(walls.kind))]
    for i in range(len(state)):
        x, y, z, reach = state[i, 0], state[i, 1], state[i, 2], reaches[i]
        for w in range(len(walls.kind)):
            if not present[w]:
                continue
            if walls.kind[w] != TRIANGLES:
                d, _ = wall_distance(walls.kind[w], walls.shape, walls.pose, w, x, y, z)
                if d < reach:
                    slots = with_room(slots, total)
                    slots[total, 0], slots[total, 1], slots[total, 2] = i, w, -1
                    total += 1
                continue
            q = to_body(walls.pose, w, x, y, z)
            first, count = walls.first_triangle[w], walls.first_triangle[w + 1] - walls.first_triangle[w]
            box = walls.first_box[w]
            leaves = (walls.first_box[w + 1] - box) // 2
            node = next_leaf(walls.box, box, leaves, 1, q, reach)
            while node > 0:
                for t in range((node - leaves) * LEAF, min((node - leaves + 1) * LEAF, count)):
                    d, _, _ = triangle_distance(walls.triangle, first + t, q)
                    if d < reach:
                        slots = with_room(slots, total)
                        slots[total, 0], slots[total, 1], slots[total, 2] = i, w, t
                        total += 1
                node = next_leaf(walls.box, box, leaves, following(node), q, reach)
    return slots[:total]


@kernel
def carry_wall_histories(near: WallList, order: Integers, old: WallList) -> None:
    """Copy what touched before; `order` (N,) are the particles' rows in the old list."""
    for p in range(len(near.owner)):
        before = order[near.owner[p]]
        row = np.searchsorted(old.owner, before)
        if row == len(old.owner) or old.owner[row] != before:
            continue
        for q in range(old.start[row], old.start[row + 1]):
            if old.history[q, OVERLAP] == 0.0:
                continue
            for k in range(near.start[p], near.start[p + 1]):
                if near.wall[k] == old.wall[q] and near.triangle[k] == old.triangle[q]:
                    near.history[k] = old.history[q]
                    near.normal[k] = old.normal[q]
                    near.push[k] = old.push[q]


@leaf
def slot_distance(near: WallList, walls: Walls, k: int, x: float, y: float, z: float) -> float:
    """Distance of a point of the world to what slot k is about, m."""
    w = near.wall[k]
    if near.triangle[k] >= 0:
        q = to_body(walls.pose, w, x, y, z)
        d, _, _ = triangle_distance(walls.triangle, walls.first_triangle[w] + near.triangle[k], q)
    else:
        d, _ = wall_distance(walls.kind[w], walls.shape, walls.pose, w, x, y, z)
    return float(d)


@kernel
def note_clear(near: WallList, state: Floats, walls: Walls) -> None:
    """Write how far each particle may go before it can touch the walls near it: a distance changes by no more than
    it moves. A wall that moves may come to it, so there nothing is known."""
    for p in range(len(near.owner)):
        i = near.owner[p]
        x, y, z, r = state[i, 0], state[i, 1], state[i, 2], state[i, 3]
        for k in range(near.start[p], near.start[p + 1]):
            if not stands(walls, near.wall[k]):
                continue
            d = slot_distance(near, walls, k, x, y, z)
            if d > r:
                # Short by more than rounding: what is skipped does not touch by a bit.
                near.clear[k] = (d - r) * (d - r) * CLEAR_SLACK


def list_walls(
    state: Floats, reach: Floats, walls: Walls, step: int, dt: float, order: Integers, old: WallList
) -> WallList:
    """Walls present at `step` within the reach (N,), m, of each particle: its radius and what it and the wall may
    go before the next list; and the poses as home of this list.

    `order` (N,) are the particles' rows at the search before, whose list is `old`.
    """
    slots = collect_slots(state, reach, walls, step, dt)
    owner, start = np.unique(slots[:, 0], return_index=True)
    total = len(slots)
    near = WallList(
        owner=owner,
        start=np.append(start, total).astype(np.int64),
        wall=slots[:, 1].astype(np.int32),
        triangle=slots[:, 2].astype(np.int32),
        clear=np.full(total, -1.0),
        history=np.zeros((total, HISTORY_WIDTH)),
        normal=np.zeros((total, 3)),
        push=np.zeros((total, 3)),
        hit=np.zeros((total, HIT_WIDTH)),
        crossed=np.full(len(owner), -1, np.int32),
        alarm=np.zeros(1, np.bool_),
    )
    carry_wall_histories(near, order, old)
    note_clear(near, state, walls)
    set_home(walls, state, reach)
    return near


@kernel
def first_inside(near: WallList, state: Floats, walls: Walls, step: int, dt: float) -> int:
    """Slot of the first particle that a wall which appears at `step` overlaps too much, or -1."""
    for p in range(len(near.owner)):
        i = near.owner[p]
        x, y, z, r = state[i, 0], state[i, 1], state[i, 2], state[i, 3]
        for k in range(near.start[p], near.start[p + 1]):
            if first_step(walls.window[near.wall[k], 0], dt) != step:
                continue
            d = slot_distance(near, walls, k, x, y, z)
            # A bed that a run starts from may have settled on the wall, as soft as it is.
            allowed = LARGEST_FIRST_OVERLAP if step > 0 else LARGEST_SETTLED_OVERLAP
            if r - d > allowed * r:
                return k
    return -1


def near_moving_walls(near: WallList, walls: Walls) -> Integers:
    """Rows of the particles that a wall is near which ever moves, or whose surface does."""
    moving = np.array(
        [not stands(walls, w) or walls.shape[w, BELT_SPEED] > 0.0 for w in range(len(walls.kind))]
    )
    if not moving.any():
        return near.owner[:0]
    slots_before = np.concatenate([[0], np.cumsum(moving[near.wall])])
    return near.owner[slots_before[near.start[1:]] > slots_before[near.start[:-1]]]


class Found(NamedTuple):
    """A particle, by its number, and a wall, by its index, that do not go together."""

    particle: int
    wall: int


def find_crossing(near: WallList, particles: Particles) -> Found | None:
    """The first particle whose centre went through a wall since the last search, and the wall."""
    if not near.alarm[0]:
        return None
    p = int(np.argmax(near.crossed >= 0))
    return Found(int(particles.number[near.owner[p]]), int(near.crossed[p]))


def forgive_crossings(near: WallList) -> int:
    """Let those that went through a wall go on behind it; how many they were."""
    crossed = near.crossed >= 0
    near.crossed[crossed] = -1
    near.alarm[0] = False
    return int(np.count_nonzero(crossed))


def find_inside(near: WallList, particles: Particles, walls: Walls, step: int, dt: float) -> Found | None:
    """The first particle that a wall which appears at this step stands in, and the wall."""
    k = first_inside(near, particles.state, walls, step, dt)
    if k < 0:
        return None
    p = int(np.searchsorted(near.start, k, side="right")) - 1
    return Found(int(particles.number[near.owner[p]]), int(near.wall[k]))


def find_racing_wall(walls: Walls, smallest_radius: float, dt: float) -> int | None:
    """The first wall that moves farther in one step than contacts with such particles can follow."""
    for w in range(len(walls.kind)):
        if largest_step(walls, w, dt) > LONGEST_STEP * smallest_radius:
            return w
    return None


def wall_label(names: Sequence[str], w: int) -> str:
    """How messages call wall w."""
    return f"wall {w} ({names[w]})" if w < len(names) and names[w] else f"wall {w}"

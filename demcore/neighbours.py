"""Neighbour search: sort along slabs and a Morton curve, list pairs within reach (grid.py), carry their history.

Notation: skin extra reach of a pair at rest, m; owner of a pair is the lower index; `mode` (N,) says who is
dormant (dormant.py).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.block import FIXED_WIDTH, LANES
from demcore.dormant import AWAKE, Dormant, is_calm
from demcore.forces import Neighbours, begin_contact, history_at
from demcore.grid import Grid, build_grid, find_partners
from demcore.jit import kernel, leaf, parallel_kernel, prange, thread_count
from demcore.particles import VX, VZ, Floats, Particles, R, X, Z
from demcore.shares import share_out
from demcore.wrench import HISTORY_WIDTH, OVERLAP, Tables

Integers = NDArray[np.int64]

MOST_SLABS = 64
# Fewer do not fill the blocks of a slab, and every slab costs a step a microsecond or more, whatever it holds.
LEAST_IN_SLAB = 128
# So many positions tell along which axis slabs divide best: to sort all, thrice, would be a tenth of a search.
ENOUGH_TO_CHOOSE = 2048
# So many steps at most do the fast ones among slow ones look ahead: a search, which costs some 20, is cheap then.
LONGEST_LOOK = 200
# This share of the particles are slow: they move half a skin in the time that the others look ahead.
SLOW_SHARE = 0.7
# One in so many near pairs may touch before the next search without calling for an early one.
NEAR_THAT_MEET = 4


def reaches(state: Floats, skin: float, dt: float) -> Floats:
    """Radius and halo (N,), m: a pair is listed whose reaches overlap, so a particle may go as far as its halo
    before a search is due. The halo is half the skin and what the particle goes at its present speed until most
    others have gone half the skin: a few fast ones (a jet over a bed at rest) do not call for a search of all."""
    speed = np.sqrt((state[:, VX : VZ + 1] ** 2).sum(axis=1))
    half, radius = 0.5 * skin, state[:, R]
    k = int(SLOW_SHARE * (len(speed) - 1))
    way = float(np.partition(speed, k)[k]) * dt
    steps = min(LONGEST_LOOK, half / way) if way > 0.0 else LONGEST_LOOK
    # A stray bullet must not make slabs and cells as wide as the plant.
    reached: Floats = radius + half + np.minimum(speed * (steps * dt), radius.max())
    return reached


def slab_bounds(sorted_position: Floats, width: float, most: int) -> Floats:
    """Lower bounds of at most so many slabs, at least `width` thick, with about equal numbers of the positions;
    the first one is -inf."""
    extent = sorted_position[-1] - sorted_position[0]
    wanted = int(max(1, min(most, MOST_SLABS, extent // width)))
    share = len(sorted_position) / wanted
    bounds = [sorted_position[0]]
    while True:
        here = np.searchsorted(sorted_position, bounds[-1])
        quantile = sorted_position[min(len(sorted_position) - 1, int(here + share))]
        following = max(bounds[-1] + width, quantile)
        # The last slab keeps the rest: a remainder thinner than `width` would let a pair skip a slab.
        if following + width > sorted_position[-1]:
            break
        bounds.append(following)
    bounds[0] = -np.inf
    return np.array(bounds)


def best_slabs(position: Floats, width: float) -> tuple[int, Floats]:
    """The axis whose fullest slab holds the fewest particles, and the bounds along it: threads wait for that slab.

    The longest axis is not it where few are spread far: a belt above a bed, a jet. Of many a sample tells.
    """
    every = max(1, len(position) // ENOUGH_TO_CHOOSE)
    sample = np.sort(position[::every], axis=0)
    most = len(position) // LEAST_IN_SLAB
    fullest = [_fullest(sample[:, axis], width, most) for axis in range(3)]
    axis = int(np.argmin(fullest))
    along = sample[:, axis] if every == 1 else np.sort(position[:, axis])
    return axis, slab_bounds(along, width, most)


def _fullest(along: Floats, width: float, most: int) -> int:
    """How many of the sorted positions `along` (N,) the fullest of at most so many slabs holds."""
    bounds = slab_bounds(along, width, most)
    return int(np.diff(np.append(np.searchsorted(along, bounds), len(along))).max())


@kernel
def spatial_keys(position: Floats, slab: Integers, origin: Floats, cell: float) -> Integers:
    """Sort keys: slab first, then the Morton code of a 16-bit cell."""
    keys = np.empty(len(slab), np.int64)
    for i in range(len(slab)):
        code = 0
        for c in range(3):
            q = min(max(int((position[i, c] - origin[c]) / cell), 0), 65535)
            q = (q | (q << 16)) & 0x0000FF0000FF
            q = (q | (q << 8)) & 0x00F00F00F00F
            q = (q | (q << 4)) & 0x0C30C30C30C3
            q = (q | (q << 2)) & 0x249249249249
            code |= q << c
        keys[i] = (slab[i] << 48) | code
    return keys


def spatial_order(position: Floats, radius: Floats, widest: float) -> tuple[Integers, Integers]:
    """Order of the particles along slabs and a Morton curve, and the slabs' first particles (S + 1,). `widest`:
    the longest distance of a pair that is listed, m."""
    axis, bounds = best_slabs(position, widest)
    slab = np.searchsorted(bounds, position[:, axis], side="right") - 1
    # Stable and nearly sorted input: timsort makes the repeated sort cheap.
    keys = spatial_keys(position, slab, position.min(axis=0), 2.0 * float(radius.mean()))
    order = np.argsort(keys, kind="stable")
    return order, np.searchsorted(slab[order], np.arange(len(bounds) + 1))


class Carried(NamedTuple):
    """The contacts of an old list by owner, so that the list itself can go: those of owner i are
    start[i]:start[i + 1] of partner (C,) and history (C, HISTORY_WIDTH)."""

    start: Integers
    partner: NDArray[np.int32]
    history: Floats


@leaf
def slots_of(lists: Neighbours, k: int) -> tuple[int, int]:
    """First slot and one behind the last of the contacts of slab k // 2: of the still ones for an odd k."""
    slab = k // 2
    if k % 2 == 1:
        first = lists.still_start[slab] * LANES
        return first, first + lists.still[slab]
    first = lists.block_start[slab] * LANES
    return first, first + lists.used[slab]


@kernel
def carry(lists: Neighbours) -> Carried:
    """Counting sort of the closed contacts by owner."""
    start = np.zeros(lists.slab_start[-1] + 1, np.int64)
    runs = 2 * len(lists.used)
    for k in range(runs):
        first, last = slots_of(lists, k)
        for s in range(first, last):
            if lists.history[history_at(s, OVERLAP)] > 0.0:
                start[lists.owner[s] + 1] += 1
    for i in range(len(start) - 1):
        start[i + 1] += start[i]
    fill = start[:-1].copy()
    partner = np.empty(start[-1], np.int32)
    history = np.empty((start[-1], HISTORY_WIDTH))
    for k in range(runs):
        first, last = slots_of(lists, k)
        for s in range(first, last):
            if lists.history[history_at(s, OVERLAP)] > 0.0:
                q = fill[lists.owner[s]]
                fill[lists.owner[s]] += 1
                partner[q] = lists.partner[s]
                for c in range(HISTORY_WIDTH):
                    history[q, c] = lists.history[history_at(s, c)]
    return Carried(start, partner, history)


@kernel
def recall_history(slot: int, a: int, b: int, carried: Carried, history: Floats) -> None:
    """Write the history of the pair whose rows at the last search were a and b; zero if it did not touch then.

    The owner may have changed with the order: spring and couple are kept for the owner, so they turn sign.
    """
    for c in range(HISTORY_WIDTH):
        history[history_at(slot, c)] = 0.0
    low, high = min(a, b), max(a, b)
    if high >= len(carried.start) - 1:
        return  # a particle that was not there at the last search
    for q in range(carried.start[low], carried.start[low + 1]):
        if carried.partner[q] == high:
            sign = 1.0 if a < b else -1.0
            for c in range(HISTORY_WIDTH):
                # The first four are scalars, the others vectors that act on the owner.
                history[history_at(slot, c)] = carried.history[q, c] * (1.0 if c < 4 else sign)
            return


@kernel
def fill_slab(
    k: int,
    found: NDArray[np.int32],
    count: Integers,
    particles: Particles,
    mode: NDArray[np.uint8],
    order: Integers,
    carried: Carried,
    new: Neighbours,
    tables: Tables,
) -> None:
    """Sort the pairs of slab k into contacts, with their histories, the still ones apart, and near pairs."""
    state = particles.state
    slot, near, q = new.block_start[k] * LANES, new.near_start[k], 0
    still_slot = new.still_start[k] * LANES
    for i in range(new.slab_start[k], new.slab_start[k + 1]):
        for _ in range(count[i]):
            j = found[q]
            q += 1
            dx, dy, dz = state[i, 0] - state[j, 0], state[i, 1] - state[j, 1], state[i, 2] - state[j, 2]
            reach = state[i, 3] + state[j, 3]
            squared = dx * dx + dy * dy + dz * dz
            if squared < reach * reach:
                still = mode[i] != AWAKE and mode[j] != AWAKE
                at = still_slot if still else slot
                begin_contact(at, i, j, particles, tables, new.owner, new.partner, new.fixed)
                recall_history(at, order[i], order[j], carried, new.history)
                slot += 0 if still else 1
                still_slot += 1 if still else 0
            else:
                new.near_owner[near], new.near_partner[near] = i, j
                new.wake[near] = 0.5 * (math.sqrt(squared) - reach)
                near += 1
    new.used[k] = slot - new.block_start[k] * LANES
    new.still[k] = still_slot - new.still_start[k] * LANES


# A search that arranges the dormant pays when it spares this share of the particles, or of the contacts.
WORTH_ARRANGING = 0.05


def pays_to_arrange(dormant: Dormant, state: Floats, lists: Neighbours) -> bool:
    """Whether many particles have become calm, or many still contacts are computed because a few woke."""
    waiting = is_calm(dormant, state) & (dormant.state == AWAKE)
    lively, blocks = int(lists.lively.sum()), len(lists.lively)
    return bool(np.count_nonzero(waiting) > WORTH_ARRANGING * len(state) or lively > WORTH_ARRANGING * blocks)


def forget_all(particles: Particles) -> Particles:
    """The same arrays with no particle in them."""
    p = particles
    return Particles(p.state[:0], p.force[:0], p.material[:0], p.number[:0])


def room_for(slabs: Integers, pairs: Integers, touching: Integers, still: Integers) -> Neighbours:
    """A list with room for the pairs of each slab, and for a share of the near ones to become contacts."""
    near = pairs - touching
    slots = touching - still + np.minimum(near, near // NEAR_THAT_MEET + LANES // 4)
    blocks, still_blocks = -(-slots // LANES), -(-still // LANES)
    block_start = np.concatenate([[0], np.cumsum(blocks + still_blocks)])
    near_start = np.concatenate([[0], np.cumsum(near)])
    total, rest, count = int(block_start[-1]), int(near_start[-1]), len(slabs) - 1
    return Neighbours(
        slabs,
        block_start,
        np.zeros(count, np.int64),
        block_start[1:] - still_blocks,
        np.zeros(count, np.int64),
        np.zeros(total, np.uint8),
        np.zeros(count, np.int64),
        np.zeros(count, np.int64),
        np.ones(1, np.uint8),
        np.empty(total * LANES, np.int32),
        np.empty(total * LANES, np.int32),
        np.empty(total * LANES * FIXED_WIDTH),
        np.empty(total * LANES * HISTORY_WIDTH),
        near_start,
        np.empty(rest, np.int32),
        np.empty(rest, np.int32),
        np.empty(rest),
        np.empty(rest, np.int32),
        np.zeros(count),
        np.zeros(count),
        np.zeros((int(slabs[-1]), 4)),
        np.zeros(count, np.uint8),
        np.zeros(count, np.uint8),
    )


def empty_neighbours(count: int) -> Neighbours:
    """A list without a pair, for `count` particles: what the first search carries history from."""
    nothing = np.zeros(1, np.int64)
    return room_for(np.array([0, count]), nothing, nothing, nothing)


def _find_all(
    slabs: Integers,
    turn: Integers,
    start: Integers,
    state: Floats,
    reach: Floats,
    mode: NDArray[np.uint8],
    grid: Grid,
    room: int,
    found: Any,
    count: Integers,
    needed: Integers,
    touching: Integers,
    still: Integers,
) -> None:
    for worker in prange(len(start) - 1):
        for k in turn[start[worker] : start[worker + 1]]:
            out = found[slabs[k] * room : slabs[k + 1] * room]
            needed[k], touching[k], still[k] = find_partners(
                slabs[k], slabs[k + 1], state, reach, mode, grid, out, count
            )


def _fill_all(
    turn: Integers,
    start: Integers,
    room: int,
    found: Any,
    count: Integers,
    particles: Particles,
    mode: NDArray[np.uint8],
    order: Integers,
    carried: Carried,
    new: Neighbours,
    tables: Tables,
) -> None:
    for worker in prange(len(start) - 1):
        for k in turn[start[worker] : start[worker + 1]]:
            out = found[new.slab_start[k] * room : new.slab_start[k + 1] * room]
            fill_slab(k, out, count, particles, mode, order, carried, new, tables)


_SEARCH: dict[bool, tuple[Any, Any]] = {
    False: (kernel(_find_all), kernel(_fill_all)),
    True: (parallel_kernel(_find_all), parallel_kernel(_fill_all)),
}


class Arranged(NamedTuple):
    """Particles in the order of slabs and a Morton curve; order (N,) are their rows before; slabs (S + 1,);
    reach (N,), m, up to where each is to be listed."""

    particles: Particles
    order: Integers
    slabs: Integers
    reach: Floats


def arrange(particles: Particles, skin: float, dt: float, keep: NDArray[np.bool_] | None = None) -> Arranged:
    """Sort the particles, those in `keep` (N,); the forces, which are zero between steps, are not carried."""
    alive = np.arange(len(particles.number)) if keep is None else np.flatnonzero(keep)
    if len(alive) == 0:
        return Arranged(forget_all(particles), alive, np.array([0, 0]), np.zeros(0))
    state = particles.state[alive]
    reach = reaches(state, skin, dt)
    order, slabs = spatial_order(state[:, X : Z + 1], state[:, R], 2.0 * float(reach.max()))
    reach, order = reach[order], alive[order]
    count = len(order)
    force = particles.force[:count] if len(particles.force) >= count else np.zeros((count, 6))
    fresh = Particles(particles.state[order], force, particles.material[order], particles.number[order])
    return Arranged(fresh, order, slabs, reach)


def list_pairs(
    arranged: Arranged,
    carried: Carried,
    mode: NDArray[np.uint8],
    tables: Tables,
    threaded: bool = False,
) -> Neighbours:
    """All pairs whose reaches overlap, with the histories of those that touched; the same bits on threads."""
    particles, order, slabs, reach = arranged
    state = particles.state
    if len(state) == 0:
        return empty_neighbours(0)
    find_all, fill_all = _SEARCH[threaded]
    # A slab of a bed holds many times as many as one of the air above it.
    shares = share_out(np.diff(slabs).astype(np.float64), thread_count() if threaded else 1)
    grid = build_grid(state, reach)
    count = np.zeros(len(state), np.int64)
    needed, touching, still = np.zeros((3, len(slabs) - 1), np.int64)
    room = 8
    while True:
        found = np.empty(len(state) * room, np.int32)
        find_all(slabs, *shares, state, reach, mode, grid, room, found, count, needed, touching, still)
        if (needed <= np.diff(slabs) * room).all():
            break
        room *= 2
    del grid
    new = room_for(slabs, needed, touching, still)
    fill_all(*shares, room, found, count, particles, mode, order, carried, new, tables)
    new.home[:, :3], new.home[:, 3] = state[:, X : Z + 1], (reach - state[:, R]) ** 2
    return new

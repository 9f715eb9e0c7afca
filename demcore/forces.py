"""The one loop over pairs of particles: a slab at a time, contacts in blocks, accumulated without races.

Why slabs: particles are sorted along one axis into slabs that are thicker than any contact is long, and a pair
is owned by its particle of lower index. The pairs of a slab then write to that slab and the next one only. So
all even slabs can run at once, then all odd ones, and every sum is made in the same order as one after another.

Why blocks: a contact is some 300 operations that wait for one another, and four at once cost little more than
one. So the contacts of a slab lie in blocks of LANES with one number of all of them side by side, and the laws,
scalar as they are, are compiled to vector instructions over a block (block.py). A lane whose contact has opened
computes on, its results replaced by zero, until the next search.

Why near pairs sleep: a pair with a gap cannot touch before the fastest particle has gone half of it. `way` counts
how far that is, and until `way` reaches the pair's `wake` it costs one comparison.

Why still blocks: what two dormant particles do to each other is constant (dormant.py). The search puts their
contacts into blocks of their own, after the others of the slab; these are computed once, into `frozen`, and then
skipped until a particle of theirs wakes.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.block import FIXED, FIXED_WIDTH, HISTORY, LANES, ROWS, Rows, gather, scatter, scatter_loads, work
from demcore.contact.model import ContactModel
from demcore.dormant import AWAKE, Dormant
from demcore.jit import kernel, leaf
from demcore.particles import Floats, Particles
from demcore.wrench import HISTORY_WIDTH, OVERLAP, Tables, series_stiffness

NEVER = 1e300


class Neighbours(NamedTuple):
    """Pairs by slab: those that touch, or did since the search, in blocks; the others in a list of near pairs.

    slab_start (S + 1,)    first particle of each slab
    block_start (S + 1,)   first block of each slab; used (S,) contacts in them, from the slab's first lane on
    still_start (S,)       first still block of each slab, up to the next slab; still (S,) contacts in them
    lively (blocks,)       1 for a still block that is computed, because one of its particles is awake
    woke (S,)              how many particles of a slab woke since the search; seen (S,) up to where a slab's still
                           blocks heeded those of the slab and the next; fresh (1,) 1 in the first step
    owner, partner         (blocks * LANES,) particles i < j of a contact
    fixed                  (blocks * FIXED_WIDTH * LANES,) m*, R*, K_l of a contact
    history                (blocks * HISTORY_WIDTH * LANES,), number c of a block's lane b at [c * LANES + b]
    near_start (S + 1,)    first near pair of each slab; near_owner, near_partner, wake (m), awake (a list's room)
    way (S,)               half of what two particles of a slab and the next may have come closer since the search
    stride (S,)            bound on a particle's way in the last step, m
    home (N, 4)            where each particle was at the search, m, and the square of how far from there its pairs
                           are known, m2; strayed (S,) 1 when a particle of the slab is farther: a search must come
    full (S,)              1 when a slab had no slot left for a new contact: a search must come first
    """

    slab_start: NDArray[np.int64]
    block_start: NDArray[np.int64]
    used: NDArray[np.int64]
    still_start: NDArray[np.int64]
    still: NDArray[np.int64]
    lively: NDArray[np.uint8]
    woke: NDArray[np.int64]
    seen: NDArray[np.int64]
    fresh: NDArray[np.uint8]
    owner: NDArray[np.int32]
    partner: NDArray[np.int32]
    fixed: Floats
    history: Floats
    near_start: NDArray[np.int64]
    near_owner: NDArray[np.int32]
    near_partner: NDArray[np.int32]
    wake: Floats
    awake: NDArray[np.int32]
    way: Floats
    stride: Floats
    home: Floats
    strayed: NDArray[np.uint8]
    full: NDArray[np.uint8]


class Contacts(NamedTuple):
    """The contacts that are closed: owner and partner (C,), rows of particles; history (C, HISTORY_WIDTH)."""

    owner: NDArray[np.int32]
    partner: NDArray[np.int32]
    history: Floats


def touching_contacts(lists: Neighbours) -> Contacts:
    """All contacts with an overlap, in the order of the loop."""
    starts = np.concatenate([lists.block_start[:-1], lists.still_start]) * LANES
    filled = np.concatenate([lists.used, lists.still])
    slots = np.concatenate([np.arange(a, a + n) for a, n in zip(starts, filled, strict=True)])
    rows = lists.history.reshape(-1, HISTORY_WIDTH, LANES)[slots // LANES, :, slots % LANES]
    touching = rows[:, OVERLAP] > 0.0
    slots = slots[touching]
    return Contacts(lists.owner[slots], lists.partner[slots], rows[touching])


@leaf
def history_at(slot: int, number: int) -> int:
    """Where in `Neighbours.history` a slot keeps a number of its history."""
    block = slot // LANES
    return (block * HISTORY_WIDTH + number) * LANES + slot - block * LANES


@leaf
def begin_contact(
    slot: int, i: int, j: int, particles: Particles, tables: Tables, owner: Any, partner: Any, fixed: Floats
) -> None:
    """Write the pair (i, j) and what of it does not change into a free slot."""
    state = particles.state
    owner[slot], partner[slot] = i, j
    block = slot // LANES
    lane = slot - block * LANES
    ri, rj, mi, mj = state[i, 3], state[j, 3], state[i, 7], state[j, 7]
    youngs = tables.youngs
    a, b = particles.material[i], particles.material[j]
    at = block * FIXED_WIDTH * LANES + lane
    fixed[at] = mi * mj / (mi + mj)
    fixed[at + LANES] = ri * rj / (ri + rj)
    fixed[at + 2 * LANES] = series_stiffness(youngs[a], youngs[b], 2.0 * ri, 2.0 * rj)


@kernel
def wake_pairs(slab: int, particles: Particles, lists: Neighbours, tables: Tables) -> None:
    """Look at the near pairs that could have met by now: those that did become contacts of the slab."""
    state, wake = particles.state, lists.wake
    first, last, way = lists.near_start[slab], lists.near_start[slab + 1], lists.way[slab]
    count = 0
    # Without a branch: which pairs wake cannot be foreseen.
    for q in range(first, last):
        lists.awake[first + count] = q
        count += 1 if wake[q] <= way else 0
    for a in range(first, first + count):
        q = lists.awake[a]
        i, j = lists.near_owner[q], lists.near_partner[q]
        dx, dy, dz = state[i, 0] - state[j, 0], state[i, 1] - state[j, 1], state[i, 2] - state[j, 2]
        reach = state[i, 3] + state[j, 3]
        squared = dx * dx + dy * dy + dz * dz
        if squared >= reach * reach:
            wake[q] = way + 0.5 * (math.sqrt(squared) - reach)
            continue
        slot = lists.block_start[slab] * LANES + lists.used[slab]
        if slot == lists.still_start[slab] * LANES:
            # One step late, by an overlap of one step's way, rather than room for every pair that is near.
            lists.full[slab] = 1
            wake[q] = way
            continue
        wake[q] = NEVER
        begin_contact(slot, i, j, particles, tables, lists.owner, lists.partner, lists.fixed)
        for c in range(HISTORY_WIDTH):
            lists.history[history_at(slot, c)] = 0.0
        lists.used[slab] += 1


@leaf
def has_awake(first: int, count: int, owner: Rows, partner: Rows, mode: NDArray[np.uint8]) -> bool:
    """True when a particle of the contacts in slots first to first + count - 1 is awake."""
    found = False
    for slot in range(first, first + count):
        found = found or mode[owner[slot]] == AWAKE or mode[partner[slot]] == AWAKE
    return found


@kernel
def slab_forces(
    slab: int,
    particles: Particles,
    lists: Neighbours,
    dormant: Dormant,
    model: ContactModel,
    tables: Tables,
    dt: float,
) -> None:
    """Add the forces of all pairs that the particles of a slab own. Still blocks are computed into `frozen` in the
    fresh step, then skipped until one of their particles wakes; from then on they are as any other."""
    wake_pairs(slab, particles, lists, tables)
    bench = np.zeros(ROWS * LANES)
    kind = np.full(LANES, -1, np.int64)
    owner, partner, lively, all_history, all_fixed = (
        lists.owner,
        lists.partner,
        lists.lively,
        lists.history,
        lists.fixed,
    )
    force, frozen, mode = particles.force, dormant.frozen, dormant.state
    fresh = lists.fresh[0] > 0
    woke = lists.woke[slab] + (lists.woke[slab + 1] if slab + 1 < len(lists.woke) else 0)
    look = fresh or woke != lists.seen[slab]
    lists.seen[slab] = woke
    used, still = lists.used[slab], lists.still[slab]
    open_blocks, still_blocks = (used + LANES - 1) // LANES, (still + LANES - 1) // LANES
    for k in range(open_blocks + still_blocks):
        is_still = k >= open_blocks
        place = k - open_blocks if is_still else k
        block = (lists.still_start[slab] if is_still else lists.block_start[slab]) + place
        count = min((still if is_still else used) - place * LANES, LANES)
        first = block * LANES
        wakes = is_still and look and lively[block] == 0 and has_awake(first, count, owner, partner, mode)
        if wakes:
            lively[block] = 1
        freezes = is_still and lively[block] == 0
        if freezes and not fresh:
            continue
        gather(first, count, particles, owner, partner, tables, bench, kind)
        # A block's numbers are copied, because only within one array the compiler sees that lanes are apart.
        for c in range(FIXED_WIDTH * LANES):
            bench[FIXED * LANES + c] = all_fixed[block * FIXED_WIDTH * LANES + c]
        for c in range(HISTORY_WIDTH * LANES):
            bench[HISTORY * LANES + c] = all_history[block * HISTORY_WIDTH * LANES + c]
        work(bench, model, dt)
        for c in range(HISTORY_WIDTH * LANES):
            all_history[block * HISTORY_WIDTH * LANES + c] = bench[HISTORY * LANES + c]
        if fresh and len(dormant.load) > 0:
            scatter_loads(first, count, owner, partner, bench, dormant)
        if not freezes:
            scatter(first, count, owner, partner, bench, force, 1.0)
        if freezes or (wakes and not fresh):
            # Who woke has not moved yet, so what is taken back is what was frozen.
            scatter(first, count, owner, partner, bench, frozen, 1.0 if freezes else -1.0)

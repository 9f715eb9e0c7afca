"""The one loop over pairs of particles: a slab at a time, contacts in blocks, accumulated without races.

Notation: n unit normal from body j to body i; s overlap; v relative velocity of the surfaces at the contact
(i minus j); arm distance of a centre to the contact plane. Force F acts on i at the contact.

Why slabs: particles are sorted along one axis into slabs that are thicker than any contact is long, and a pair
is owned by its particle of lower index. The pairs of a slab then write to that slab and the next one only. So
all even slabs can run at once, then all odd ones, and every sum is made in the same order as one after another.

Why blocks: a contact is some 300 operations that wait for one another, and four at once cost little more than
one. So the contacts of a slab lie in blocks of LANES with one number of all of them side by side, and the laws,
scalar as they are, are compiled to vector instructions over a block. A lane whose contact has opened computes
on, its results replaced by zero, until the next search.

Why near pairs sleep: a pair with a gap cannot touch before the fastest particle has gone half of it. `way` counts
how far that is, and until `way` reaches the pair's `wake` it costs one comparison.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.contact.model import ContactModel, History, Pair, Vec3
from demcore.jit import kernel, leaf
from demcore.particles import Floats, Particles
from demcore.wrench import (
    HISTORY_WIDTH,
    OVERLAP,
    Tables,
    contact_wrench,
    series_stiffness,
)

LANES = 32
# Numbers of a contact that do not change while it is listed: effective mass, effective radius, stiffness K_l.
FIXED_WIDTH = 3
NEVER = 1e300


class Neighbours(NamedTuple):
    """Pairs by slab: those that touch, or did since the search, in blocks; the others in a list of near pairs.

    slab_start (S + 1,)    first particle of each slab
    block_start (S + 1,)   first block of each slab; used (S,) contacts in them, from the slab's first lane on
    owner, partner         (blocks * LANES,) particles i < j of a contact
    fixed                  (blocks * FIXED_WIDTH * LANES,) m*, R*, K_l of a contact
    history                (blocks * HISTORY_WIDTH * LANES,), number c of a block's lane b at [c * LANES + b]
    near_start (S + 1,)    first near pair of each slab; near_owner, near_partner, wake (m), awake (a list's room)
    way (S,)               half of what two particles of a slab and the next may have come closer since the search
    travel (S,)            bound on a particle's way since the search; stride (S,) on its last step. All in m
    full (S,)              1 when a slab had no slot left for a new contact: a search must come first
    """

    slab_start: NDArray[np.int64]
    block_start: NDArray[np.int64]
    used: NDArray[np.int64]
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
    travel: Floats
    stride: Floats
    full: NDArray[np.uint8]


class Contacts(NamedTuple):
    """The contacts that are closed: owner and partner (C,), rows of particles; history (C, HISTORY_WIDTH)."""

    owner: NDArray[np.int32]
    partner: NDArray[np.int32]
    history: Floats


def touching_contacts(lists: Neighbours) -> Contacts:
    """All contacts with an overlap, in the order of the loop."""
    lane = np.arange(LANES)
    slots = np.concatenate(
        [
            np.arange(first * LANES, first * LANES + used)
            for first, used in zip(lists.block_start[:-1], lists.used, strict=True)
        ]
        or [lane[:0]]
    )
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
        if slot == lists.block_start[slab + 1] * LANES:
            # One step late, by an overlap of one step's way, rather than room for every pair that is near.
            lists.full[slab] = 1
            wake[q] = way
            continue
        wake[q] = NEVER
        begin_contact(slot, i, j, particles, tables, lists.owner, lists.partner, lists.fixed)
        for c in range(HISTORY_WIDTH):
            lists.history[history_at(slot, c)] = 0.0
        lists.used[slab] += 1


# Rows of the bench, on which a block is worked: LANES numbers each. What comes in ...
_DX, _DY, _DZ, _VX, _VY, _VZ, _WX, _WY, _WZ, _UX, _UY, _UZ, _RI, _RJ = range(14)
_YOUNGS, _SHEAR, _RESTITUTION, _UNLOADING, _RATIO, _STATIC, _DYNAMIC, _ROLLING = range(14, 22)
_FIXED = 22
_HISTORY = _FIXED + FIXED_WIDTH
# ... and what goes out: force, torque on i, torque on j (to be subtracted).
_F, _TI, _TJ = _HISTORY + HISTORY_WIDTH, _HISTORY + HISTORY_WIDTH + 3, _HISTORY + HISTORY_WIDTH + 6
_ROWS = _TJ + 3


@leaf
def gather(
    first: int, count: int, particles: Particles, lists: Neighbours, tables: Tables, bench: Floats, kind: Any
) -> None:
    """Bring the particles of the contacts in slots first to first + count - 1 to the bench."""
    state, p = particles.state, tables.pair
    for b in range(count):
        i, j = lists.owner[first + b], lists.partner[first + b]
        for c in range(3):
            bench[(_DX + c) * LANES + b] = state[i, c] - state[j, c]
            bench[(_VX + c) * LANES + b] = state[i, 4 + c] - state[j, 4 + c]
            bench[(_WX + c) * LANES + b] = state[i, 8 + c]
            bench[(_UX + c) * LANES + b] = state[j, 8 + c]
        bench[_RI * LANES + b] = state[i, 3]
        bench[_RJ * LANES + b] = state[j, 3]
        m, n = particles.material[i], particles.material[j]
        # Most neighbours in the list are of the same materials as the lane's last pair.
        if kind[b] != m * len(tables.youngs) + n:
            kind[b] = m * len(tables.youngs) + n
            bench[_YOUNGS * LANES + b] = p[m, n, 4]
            bench[_SHEAR * LANES + b] = p[m, n, 5]
            bench[_RESTITUTION * LANES + b] = p[m, n, 0]
            bench[_UNLOADING * LANES + b] = p[m, n, 6]
            bench[_RATIO * LANES + b] = p[m, n, 7]
            bench[_STATIC * LANES + b] = p[m, n, 1]
            bench[_DYNAMIC * LANES + b] = p[m, n, 2]
            bench[_ROLLING * LANES + b] = p[m, n, 3]


@leaf
def lane_pair(bench: Floats, b: int) -> Any:
    """The Pair of lane b."""
    return Pair(
        bench[_FIXED * LANES + b],
        bench[(_FIXED + 1) * LANES + b],
        bench[(_FIXED + 2) * LANES + b],
        bench[_YOUNGS * LANES + b],
        bench[_SHEAR * LANES + b],
        bench[_RESTITUTION * LANES + b],
        bench[_UNLOADING * LANES + b],
        bench[_RATIO * LANES + b],
        bench[_STATIC * LANES + b],
        bench[_DYNAMIC * LANES + b],
        bench[_ROLLING * LANES + b],
    )


@leaf
def lane_history(bench: Floats, b: int) -> Any:
    """The History of lane b."""
    h = _HISTORY
    return History(
        bench[h * LANES + b],
        bench[(h + 1) * LANES + b],
        bench[(h + 2) * LANES + b],
        bench[(h + 3) * LANES + b],
        Vec3(bench[(h + 4) * LANES + b], bench[(h + 5) * LANES + b], bench[(h + 6) * LANES + b]),
        Vec3(bench[(h + 7) * LANES + b], bench[(h + 8) * LANES + b], bench[(h + 9) * LANES + b]),
    )


@leaf
def put(bench: Floats, row: int, b: int, value: float, touching: bool) -> None:
    """Write a result of lane b; zero where the contact is open, whatever was computed there."""
    bench[row * LANES + b] = value if touching else 0.0


@leaf
def work(bench: Floats, model: ContactModel, dt: float) -> None:
    """All contacts of the bench: constant trip count and no branch, so that it becomes vector instructions."""
    for b in range(LANES):
        dx, dy, dz = bench[_DX * LANES + b], bench[_DY * LANES + b], bench[_DZ * LANES + b]
        ri, rj = bench[_RI * LANES + b], bench[_RJ * LANES + b]
        d = math.sqrt(dx * dx + dy * dy + dz * dz)
        inverse = 1.0 / d
        n = Vec3(dx * inverse, dy * inverse, dz * inverse)
        s = ri + rj - d
        arm_i, arm_j = ri - 0.5 * s, rj - 0.5 * s
        # Surface velocity: spins act through the arms, (arm_i w_i + arm_j w_j) x n.
        wx, wy, wz = bench[_WX * LANES + b], bench[_WY * LANES + b], bench[_WZ * LANES + b]
        qx, qy, qz = bench[_UX * LANES + b], bench[_UY * LANES + b], bench[_UZ * LANES + b]
        ux, uy, uz = arm_i * wx + arm_j * qx, arm_i * wy + arm_j * qy, arm_i * wz + arm_j * qz
        v = Vec3(
            bench[_VX * LANES + b] - (uy * n.z - uz * n.y),
            bench[_VY * LANES + b] - (uz * n.x - ux * n.z),
            bench[_VZ * LANES + b] - (ux * n.y - uy * n.x),
        )
        spin = Vec3(wx - qx, wy - qy, wz - qz)
        wrench = contact_wrench(model, lane_pair(bench, b), s, n, v, spin, lane_history(bench, b), dt)
        touching = s > 0.0
        after, force, ft, couple = wrench.history, wrench.force, wrench.tangential, wrench.couple
        put(bench, _HISTORY, b, after.elastic, touching)
        put(bench, _HISTORY + 1, b, after.overlap, touching)
        put(bench, _HISTORY + 2, b, after.age, touching)
        put(bench, _HISTORY + 3, b, after.sliding, touching)
        put(bench, _HISTORY + 4, b, after.spring.x, touching)
        put(bench, _HISTORY + 5, b, after.spring.y, touching)
        put(bench, _HISTORY + 6, b, after.spring.z, touching)
        put(bench, _HISTORY + 7, b, after.couple.x, touching)
        put(bench, _HISTORY + 8, b, after.couple.y, touching)
        put(bench, _HISTORY + 9, b, after.couple.z, touching)
        put(bench, _F, b, force.x, touching)
        put(bench, _F + 1, b, force.y, touching)
        put(bench, _F + 2, b, force.z, touching)
        # Torque of F_t about each centre: -arm n x F_t on both sides.
        cx = n.y * ft.z - n.z * ft.y
        cy = n.z * ft.x - n.x * ft.z
        cz = n.x * ft.y - n.y * ft.x
        put(bench, _TI, b, couple.x - arm_i * cx, touching)
        put(bench, _TI + 1, b, couple.y - arm_i * cy, touching)
        put(bench, _TI + 2, b, couple.z - arm_i * cz, touching)
        put(bench, _TJ, b, couple.x + arm_j * cx, touching)
        put(bench, _TJ + 1, b, couple.y + arm_j * cy, touching)
        put(bench, _TJ + 2, b, couple.z + arm_j * cz, touching)


@leaf
def scatter(first: int, count: int, lists: Neighbours, bench: Floats, force: Floats) -> None:
    """Add the results of a block to its particles, lane after lane."""
    for b in range(count):
        i, j = lists.owner[first + b], lists.partner[first + b]
        for c in range(3):
            force[i, c] += bench[(_F + c) * LANES + b]
            force[i, 3 + c] += bench[(_TI + c) * LANES + b]
        for c in range(3):
            force[j, c] -= bench[(_F + c) * LANES + b]
            force[j, 3 + c] -= bench[(_TJ + c) * LANES + b]


@kernel
def slab_forces(
    slab: int,
    particles: Particles,
    lists: Neighbours,
    model: ContactModel,
    tables: Tables,
    dt: float,
) -> None:
    """Add the forces of all pairs that the particles of a slab own."""
    wake_pairs(slab, particles, lists, tables)
    bench = np.zeros(_ROWS * LANES)
    kind = np.full(LANES, -1, np.int64)
    left = lists.used[slab]
    block = lists.block_start[slab]
    while left > 0:
        count = min(left, LANES)
        gather(block * LANES, count, particles, lists, tables, bench, kind)
        fixed, history = block * FIXED_WIDTH * LANES, block * HISTORY_WIDTH * LANES
        # A block's numbers are copied, because only within one array the compiler sees that lanes are apart.
        for c in range(FIXED_WIDTH * LANES):
            bench[_FIXED * LANES + c] = lists.fixed[fixed + c]
        for c in range(HISTORY_WIDTH * LANES):
            bench[_HISTORY * LANES + c] = lists.history[history + c]
        work(bench, model, dt)
        for c in range(HISTORY_WIDTH * LANES):
            lists.history[history + c] = bench[_HISTORY * LANES + c]
        scatter(block * LANES, count, lists, bench, particles.force)
        block += 1
        left -= count

"""A block of contacts on the bench: particles gathered lane by lane, the laws on all lanes at once, results added.

Notation: n unit normal from body j to body i; s overlap; v relative velocity of the surfaces at the contact
(i minus j); arm distance of a centre to the contact plane. Force F acts on i at the contact. A lane is a contact.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from demcore.contact.model import ContactModel, History, Pair, Vec3
from demcore.dormant import DORMANT, Dormant
from demcore.jit import leaf
from demcore.particles import Floats, Particles
from demcore.wrench import HISTORY_WIDTH, Tables, contact_wrench

LANES = 32
# Numbers of a contact that do not change while it is listed: effective mass, effective radius, stiffness K_l.
FIXED_WIDTH = 3
Rows = NDArray[np.int32]

# Rows of the bench, on which a block is worked: LANES numbers each. What comes in ...
_DX, _DY, _DZ, _VX, _VY, _VZ, _WX, _WY, _WZ, _UX, _UY, _UZ, _RI, _RJ = range(14)
_YOUNGS, _SHEAR, _RESTITUTION, _UNLOADING, _RATIO, _STATIC, _DYNAMIC, _ROLLING = range(14, 22)
FIXED = 22
HISTORY = FIXED + FIXED_WIDTH
# ... and what goes out: force, torque on i, torque on j (to be subtracted).
_F, _TI, _TJ = HISTORY + HISTORY_WIDTH, HISTORY + HISTORY_WIDTH + 3, HISTORY + HISTORY_WIDTH + 6
ROWS = _TJ + 3


@leaf
def gather(
    first: int,
    count: int,
    particles: Particles,
    owner: Rows,
    partner: Rows,
    tables: Tables,
    bench: Floats,
    kind: Any,
) -> None:
    """Bring the particles of the contacts in slots first to first + count - 1 to the bench."""
    state, p = particles.state, tables.pair
    for b in range(count):
        i, j = owner[first + b], partner[first + b]
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
        bench[FIXED * LANES + b],
        bench[(FIXED + 1) * LANES + b],
        bench[(FIXED + 2) * LANES + b],
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
    h = HISTORY
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
        put(bench, HISTORY, b, after.elastic, touching)
        put(bench, HISTORY + 1, b, after.overlap, touching)
        put(bench, HISTORY + 2, b, after.age, touching)
        put(bench, HISTORY + 3, b, after.sliding, touching)
        put(bench, HISTORY + 4, b, after.spring.x, touching)
        put(bench, HISTORY + 5, b, after.spring.y, touching)
        put(bench, HISTORY + 6, b, after.spring.z, touching)
        put(bench, HISTORY + 7, b, after.couple.x, touching)
        put(bench, HISTORY + 8, b, after.couple.y, touching)
        put(bench, HISTORY + 9, b, after.couple.z, touching)
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
def scatter(
    first: int, count: int, owner: Rows, partner: Rows, bench: Floats, force: Floats, sign: float
) -> None:
    """Add the results of a block, or take them away with `sign` -1, to its particles, lane after lane."""
    for b in range(count):
        i, j = owner[first + b], partner[first + b]
        for c in range(3):
            force[i, c] += sign * bench[(_F + c) * LANES + b]
            force[i, 3 + c] += sign * bench[(_TI + c) * LANES + b]
        for c in range(3):
            force[j, c] -= sign * bench[(_F + c) * LANES + b]
            force[j, 3 + c] -= sign * bench[(_TJ + c) * LANES + b]


@leaf
def scatter_loads(
    first: int, count: int, owner: Rows, partner: Rows, bench: Floats, dormant: Dormant
) -> None:
    """Add half the force of each contact of a block to what its particles carry, those that are not dormant."""
    mode, load = dormant.state, dormant.load
    for b in range(count):
        x, y, z = bench[_F * LANES + b], bench[(_F + 1) * LANES + b], bench[(_F + 2) * LANES + b]
        half = 0.5 * math.sqrt(x * x + y * y + z * z)
        i, j = owner[first + b], partner[first + b]
        if mode[i] != DORMANT:
            load[i] += half
        if mode[j] != DORMANT:
            load[j] += half

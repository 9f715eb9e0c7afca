"""Who of a bed is dormant, and how that is judged: the record that the search arranges and the loops keep.

A dormant particle is held where it is, without velocity or spin. What two dormant ones do to each other is then
constant, so their contacts lie in blocks of their own that are skipped whole (forces.py), and so do contacts of a
dormant particle with walls that stand. What was skipped is kept as one sum a particle, `frozen`; it wakes when
that and the forces that still act differ from `held`, what held it in balance, by more than a share of its weight
or of `load`, what went through it then: deep in a bed many weights, and friction holds in proportion to it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.dormancy import Dormancy
from demcore.particles import Floats, R

# AWAKE; FALLING: held from the search on, and judged in the first step after it; DORMANT.
AWAKE, FALLING, DORMANT = 0, 1, 2
# Steps between two looks at whether a search would pay that arranges who is dormant: it costs some ten steps.
LOOK_STEPS = 200
# Rows of `limits`.
SPEED, FORCE, WAKE, CALM, FORCE_LOAD, WAKE_LOAD = 0, 1, 2, 3, 4, 5


class Dormant(NamedTuple):
    """Without the option, `state` is zeros and all others are empty.

    state (N,)     AWAKE, FALLING or DORMANT
    calm (N,)      steps on end that a particle has been slow and hardly accelerated
    held (N, 6)    force N and torque N m of all contacts when it fell dormant
    frozen (N, 6)  the part of them that is not computed now
    load (N,)      half the sum of the forces of all contacts, N: of the last search, or when it fell dormant
    limits (6,)    speed^2 over radius, m/s2; accelerations that keep from falling and that wake, m/s2; calm
                   steps over the root of the radius, m^-1/2; shares of the load that keep from falling and that
                   wake
    gravity (3,)   m/s2, under which they were judged
    """

    state: NDArray[np.uint8]
    calm: NDArray[np.int32]
    held: Floats
    frozen: Floats
    load: Floats
    limits: Floats
    gravity: Floats


def nobody_dormant(count: int) -> Dormant:
    """The record of a run without the option, for so many particles."""
    none, nothing = np.zeros((0, 6)), np.zeros(0)
    return Dormant(np.zeros(count, np.uint8), np.zeros(0, np.int32), none, none, nothing, nothing, nothing)


def all_awake(count: int, dormancy: Dormancy, gravity: Floats, dt: float) -> Dormant:
    """The record of a run with the option at its start; without gravity nobody ever falls dormant."""
    g = math.sqrt(float((gravity**2).sum()))
    d = dormancy
    calm = d.duration_share * math.sqrt(2.0 / g) / dt if g > 0.0 else math.inf
    limits = np.array(
        [2.0 * g * d.speed_share**2, d.force_share * g, d.wake_share * g, calm, d.force_share, d.wake_share]
    )
    zeros = np.zeros((count, 6))
    state, calm_steps, load = np.zeros(count, np.uint8), np.zeros(count, np.int32), np.zeros(count)
    return Dormant(state, calm_steps, zeros, zeros.copy(), load, limits, gravity.copy())


def with_awake(dormant: Dormant, fresh: int) -> Dormant:
    """The record with so many awake particles at its end."""
    state = np.append(dormant.state, np.zeros(fresh, np.uint8))
    if not len(dormant.limits):
        return dormant._replace(state=state)
    calm = np.append(dormant.calm, np.zeros(fresh, np.int32))
    held, frozen = (np.concatenate([rows, np.zeros((fresh, 6))]) for rows in (dormant.held, dormant.frozen))
    load = np.append(dormant.load, np.zeros(fresh))
    return dormant._replace(state=state, calm=calm, held=held, frozen=frozen, load=load)


def reordered(dormant: Dormant, order: NDArray[np.int64]) -> Dormant:
    """The record after a search, which computes anew what is frozen; `order` (K,) are the rows before it."""
    state = dormant.state[order]
    if not len(dormant.limits):
        return dormant._replace(state=state)
    frozen = np.zeros((len(order), 6))
    calm, held, load = dormant.calm[order], dormant.held[order], dormant.load[order]
    return dormant._replace(state=state, calm=calm, held=held, frozen=frozen, load=load)


def is_calm(dormant: Dormant, particles_state: Floats) -> NDArray[np.bool_]:
    """Who (N,) has been calm for long enough to fall dormant."""
    calm: NDArray[np.bool_] = dormant.calm >= dormant.limits[CALM] * np.sqrt(particles_state[:, R])
    return calm


def next_look(dormant: Dormant, step: int, searched: int) -> float:
    """The first step after `step` at which a search may be called to arrange the dormant, every LOOK_STEPS after
    the last one, which arranged them too, at step `searched`; inf without them."""
    if not len(dormant.limits):
        return math.inf
    return step - (step - searched) % LOOK_STEPS + LOOK_STEPS

"""Driven surfaces: a sphere dropped on a belt, and material that a belt's head drum throws.

Notation: R drum radius with its belt, m; r particle radius; rho = R + r, radius of the centre's path; W drum
speed, rad/s; phi angle past the top; u = v^2/(g rho).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from demcore.case import Interaction, MaterialTable, Stiffness
from demcore.contact.laws import paper_model
from demcore.geometry.wall_arrays import wall_arrays
from demcore.geometry.walls import Wall
from demcore.particles import VX, WX, X, Z, spheres
from demcore.simulation import Simulation
from demcore.time_step import time_step
from demcore.verification.outcome import SECTION_3, Outcome, share_of
from demcore.verification.single_sphere import (
    DENSITY,
    POISSON,
    YOUNGS,
    G,
    single,
    sphere_mass,
    state,
)

WY = WX + 1
BELT_SPEED = 1.79
DRUM = 0.375 + 0.012
GRAIN = 0.001


def belt_drop() -> Iterator[Outcome]:
    """A free sphere on a belt at v ends at 2/7 v, spinning backwards, when mu_r = 0."""
    radius, v = 0.02, BELT_SPEED
    belt = Wall("plane", surface_velocity=(v, 0.0, 0.0))
    load = sphere_mass(radius) * G
    s = single(
        Interaction(0.2, 0.5, 0.45, 0.0),
        [belt],
        (0.0, 0.0, radius - load / (YOUNGS * radius)),
        radius=radius,
        gravity=(0.0, 0.0, -G),
    )
    s.advance(int(1.0 / s.dt))
    yield share_of("sphere on a belt: speed / m/s", SECTION_3, 2 / 7 * v, state(s, VX), 0.01)
    yield share_of("sphere on a belt: spin / rad/s", SECTION_3, -5 / 7 * v / radius, state(s, WY), 0.01)


@dataclass(frozen=True)
class Grip(MaterialTable):
    """Friction and rolling resistance without limit, which no input may ask for: material that rides the belt."""

    def arrays(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        youngs, pair = super().arrays()
        pair[:, :, 1:4] = 1e4
        return youngs, pair


def ride(mu: float | None) -> tuple[float, float, float]:
    """A grain rides a turning drum from its top; mu None grips. Angle where it leaves (deg), and x, z at the end.

    It does not roll (its rolling resistance is larger than its friction), as a layer of material does not.
    """
    contact = Interaction(0.24, mu or 0.0, mu or 0.0, 10.0)
    stiffness = (Stiffness(YOUNGS, POISSON),) * 2
    table = (Grip if mu is None else MaterialTable)(stiffness, ((contact,) * 2,) * 2)
    speed, rho = BELT_SPEED / DRUM, DRUM + GRAIN
    load = sphere_mass(GRAIN) * (G - speed * speed * rho)
    height = rho - load / (YOUNGS * GRAIN)
    drum = Wall(
        "cylinder",
        (0.0, -0.1, 0.0),
        (0.0, 1.0, 0.0),
        radius=DRUM,
        length=0.2,
        angular_velocity=(0.0, speed, 0.0),
    )
    s = Simulation(
        spheres(
            np.array([[0.0, 0.0, height]]),
            np.array([GRAIN]),
            DENSITY,
            velocity=np.array([[speed * height, 0.0, 0.0]]),
            spin=np.array([[0.0, speed, 0.0]]),
        ),
        wall_arrays([drum]),
        paper_model(),
        table,
        time_step(2 * GRAIN, DENSITY, YOUNGS, 0.24),
        gravity=np.array([0.0, 0.0, -G]),
    )
    angle = 0.0
    end = math.radians(gripped_angle()) / speed + 0.15
    while s.time < end:
        s.advance(10)
        x, z = state(s, X), state(s, Z)
        if math.hypot(x, z) < rho:
            angle = math.degrees(math.atan2(x, z))
    return angle, state(s, X), state(s, Z)


def gripped_angle() -> float:
    """cos phi = v^2/(g R): there the belt's speed alone balances gravity, deg. 32.4 for 1.79 m/s and .387 m."""
    return math.degrees(math.acos(BELT_SPEED**2 / (G * DRUM)))


def slid_angle(mu: float) -> float:
    """Where a block with friction mu leaves, deg. Sticks until sin phi = mu (cos phi - u0), then slides:

    du/dphi = 2 sin phi - 2 mu (cos phi - u), solved by u = a sin phi + b cos phi + c exp(2 mu phi); leaves at
    u = cos phi. Both roots by bisection.
    """
    rho = DRUM + GRAIN
    u0 = (BELT_SPEED / DRUM) ** 2 * rho / G
    slips = _root(lambda p: math.sin(p) - mu * (math.cos(p) - u0))
    a = -6.0 * mu / (1.0 + 4.0 * mu * mu)
    b = (4.0 * mu * mu - 2.0) / (1.0 + 4.0 * mu * mu)
    c = (u0 - a * math.sin(slips) - b * math.cos(slips)) * math.exp(-2.0 * mu * slips)
    return math.degrees(
        _root(lambda p: a * math.sin(p) + b * math.cos(p) + c * math.exp(2.0 * mu * p) - math.cos(p), slips)
    )


def _root(f: Callable[[float], float], low: float = 0.0) -> float:
    """Where f, negative at `low`, first turns positive (up to a right angle)."""
    steps = np.linspace(low, math.pi / 2, 2001)[1:]
    high = next(float(p) for p in steps if f(float(p)) > 0.0)
    low = high - (math.pi / 2 - low) / 2000.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if f(middle) > 0.0 else (middle, high)
    return high


def head_drum() -> Iterator[Outcome]:
    """Material that rides the belt leaves 32.4 degrees past the top and then follows a parabola."""
    expected, speed = 32.4, BELT_SPEED / DRUM
    angle, x, z = ride(None)
    yield Outcome("head drum, gripped: leaves / deg", SECTION_3, expected, angle, 1.0)
    th, t = math.radians(expected), 0.15
    rho = DRUM + GRAIN
    fall_x = rho * math.sin(th) + speed * rho * math.cos(th) * t
    fall_z = rho * math.cos(th) - speed * rho * math.sin(th) * t - 0.5 * G * t * t
    # One degree of the drum.
    yield Outcome("head drum, gripped: x .15 s later / m", SECTION_3, fall_x, x, math.radians(rho))
    yield Outcome("head drum, gripped: z .15 s later / m", SECTION_3, fall_z, z, math.radians(rho))
    for mu in (0.2, 0.5, 5.0):
        name = f"head drum, sliding with mu = {mu:g}: leaves / deg"
        yield Outcome(name, "equation of motion (belts.py)", slid_angle(mu), ride(mu)[0], 0.5)

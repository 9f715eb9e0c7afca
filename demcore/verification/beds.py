"""Beds that the many-particle cases share: a loose column in a cylinder, and how long until it rests."""

from __future__ import annotations

import copy
import math

import numpy as np

from demcore.case import Interaction, Stiffness, uniform_table
from demcore.contact.laws import paper_model
from demcore.contact.model import ContactModel
from demcore.errors import NeverSettles
from demcore.geometry.wall_arrays import wall_arrays
from demcore.geometry.walls import Wall
from demcore.insertion import fill_cylinder
from demcore.particles import VX, VZ, Floats, M, Particles, R, Z, spheres
from demcore.simulation import Simulation
from demcore.time_step import time_step

YOUNGS, POISSON, DENSITY = 1e7, 0.25, 2500.0
G = 9.81
# At rest: rms speed below this share of sqrt(g d), d the mean diameter.
REST_SPEED = 0.005


def tube(radius: float, axis: Floats | None = None, centre: Floats | None = None) -> list[Wall]:
    """A plane and a long tube that stands on it; by default at the origin along z."""
    a = (0.0, 0.0, 1.0) if axis is None else (float(axis[0]), float(axis[1]), float(axis[2]))
    c = (0.0, 0.0, 0.0) if centre is None else (float(centre[0]), float(centre[1]), float(centre[2]))
    return [Wall("plane", c, a), Wall("cylinder", c, a, radius=radius, length=100.0 * radius)]


def column(
    radius: Floats,
    cylinder_radius: float,
    seed: int,
    walls: list[Wall],
    contact: Interaction,
    model: ContactModel | None = None,
    youngs: float = YOUNGS,
) -> Simulation:
    """Spheres of `radius` (N,), m, as a loose column above z = 0, falling between `walls`."""
    position = fill_cylinder(radius, cylinder_radius, np.random.default_rng([31, seed]))
    dt = time_step(2.0 * float(radius.min()), DENSITY, youngs, contact.restitution)
    return Simulation(
        spheres(position, radius, DENSITY),
        wall_arrays(walls),
        model or paper_model(),
        uniform_table(Stiffness(youngs, POISSON), contact),
        dt,
    )


def wall_push(s: Simulation, wall: int) -> Floats:
    """Force of one wall on each particle, (N, 3), N, in the order of their numbers: one step of two copies, with
    and without the wall. It is what the particles feel, whatever the code believes."""
    velocities = []
    for present in (True, False):
        twin = copy.deepcopy(s)
        if not present:
            twin.remove_wall(wall)
        twin.advance(1)
        order = np.argsort(twin.particles.number)
        velocities.append(twin.particles.state[order, VX : VZ + 1])
    mass = s.particles.state[np.argsort(s.particles.number), M]
    push: Floats = (velocities[0] - velocities[1]) * mass[:, None] / s.dt
    return push


def rms_speed(particles: Particles) -> float:
    """Root of the mass-weighted mean squared speed, m/s."""
    state = particles.state
    if len(state) == 0:
        return 0.0
    mass = state[:, M]
    return math.sqrt(float((mass * (state[:, VX : VZ + 1] ** 2).sum(axis=1)).sum() / mass.sum()))


def run_to_rest(s: Simulation, least: float, longest: float, rest_speed: float = REST_SPEED) -> None:
    """Advance at least `least` s and until the bed rests. Raises NeverSettles after `longest` s."""
    begin = s.time
    diameter = 2.0 * float(s.particles.state[:, R].mean())
    interval = max(1, round(0.02 / s.dt))
    while True:
        s.advance(interval)
        passed = s.time - begin
        if passed >= least and rms_speed(s.particles) < rest_speed * math.sqrt(G * diameter):
            return
        if passed > longest:
            raise NeverSettles(
                f"the bed still moves at {rms_speed(s.particles):.3g} m/s after {passed:.1f} s"
            )


def fall_time(s: Simulation) -> float:
    """Seconds that the highest particle needs to fall to z = 0."""
    return math.sqrt(2.0 * float(s.particles.state[:, Z].max()) / G)

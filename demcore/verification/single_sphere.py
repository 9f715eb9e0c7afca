"""One sphere and its walls, or two spheres: the smallest simulations, for impacts and rolling."""

from __future__ import annotations

import math

import numpy as np

from demcore.case import Interaction, Stiffness, uniform_table
from demcore.contact.laws import paper_model
from demcore.contact.model import ContactModel
from demcore.geometry.wall_arrays import wall_arrays
from demcore.geometry.walls import Wall
from demcore.particles import spheres
from demcore.simulation import Simulation
from demcore.time_step import time_step

YOUNGS, POISSON, DENSITY = 1e7, 0.25, 2500.0
G = 9.81
FLOOR = Wall("plane")

Triple = tuple[float, float, float]


def single(
    contact: Interaction,
    walls: list[Wall],
    position: Triple,
    velocity: Triple = (0.0, 0.0, 0.0),
    spin: Triple = (0.0, 0.0, 0.0),
    radius: float = 0.01,
    gravity: Triple = (0.0, 0.0, 0.0),
    model: ContactModel | None = None,
    finer: float = 1.0,
    youngs: float = YOUNGS,
) -> Simulation:
    """One sphere of the standard density and its walls, at the paper's time step divided by `finer`."""
    bed = spheres(
        np.array([position]),
        np.array([radius]),
        DENSITY,
        velocity=np.array([velocity]),
        spin=np.array([spin]),
    )
    return Simulation(
        bed,
        wall_arrays(walls),
        model or paper_model(),
        uniform_table(Stiffness(youngs, POISSON), contact),
        time_step(2.0 * radius, DENSITY, youngs, contact.restitution, "paper") / finer,
        gravity=np.array(gravity),
    )


def state(s: Simulation, column: int) -> float:
    """A number of the only sphere; columns as in demcore.particles."""
    return float(s.particles.state[0, column])


def sphere_mass(radius: float, density: float = DENSITY) -> float:
    """kg."""
    return density * 4.0 / 3.0 * math.pi * radius**3


def on_floor(
    contact: Interaction,
    radius: float,
    th: float = 0.0,
    velocity: Triple = (0.0, 0.0, 0.0),
    spin: Triple = (0.0, 0.0, 0.0),
) -> Simulation:
    """A sphere at its resting overlap on a plane; gravity is turned by `th` (rad) instead of the plane."""
    overlap = sphere_mass(radius) * G * math.cos(th) / (YOUNGS * radius)
    gravity = (G * math.sin(th), 0.0, -G * math.cos(th))
    start = (0.0, 0.0, radius - overlap)
    return single(contact, [FLOOR], start, velocity, spin, radius=radius, gravity=gravity)

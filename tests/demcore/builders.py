"""Small beds for tests."""

from __future__ import annotations

import numpy as np

from demcore.case import Interaction, Stiffness, uniform_table
from demcore.contact.laws import paper_model
from demcore.geometry.wall_arrays import wall_arrays
from demcore.geometry.walls import Wall
from demcore.insertion import fill_cylinder
from demcore.particles import spheres
from demcore.simulation import Simulation
from demcore.time_step import time_step

CONTACT = Interaction(0.3, 0.5, 0.45, 0.2)


def bed(
    count=200,
    seed=1,
    contact=CONTACT,
    model=None,
    threaded=False,
    walls=None,
    gravity=(0.0, 0.0, -9.81),
    dormancy=None,
):
    """Spheres of 10 to 30 mm falling into a cylinder of radius 60 mm."""
    rng = np.random.default_rng(seed)
    radius = rng.uniform(0.005, 0.015, count)
    position = fill_cylinder(radius, 0.06, rng)
    if walls is None:
        walls = [Wall("plane"), Wall("cylinder", radius=0.06, length=10.0)]
    return Simulation(
        spheres(position, radius, 2500.0),
        wall_arrays(walls),
        model or paper_model(),
        uniform_table(Stiffness(1e7, 0.25), contact),
        time_step(0.01, 2500.0, 1e7, contact.restitution),
        gravity=np.array(gravity),
        threaded=threaded,
        dormancy=dormancy,
    )


def by_number(simulation):
    """State rows in the order of the particles' names."""
    return simulation.particles.state[np.argsort(simulation.particles.number)]

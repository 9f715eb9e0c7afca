"""Cohesion in the real kernel, against forces that balance by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from demcore.case import Interaction, Stiffness, uniform_table
from demcore.contact.laws import paper_model
from demcore.contact.linear_cohesion import LinearCohesion, linear_cohesion
from demcore.contact.liquid_bridge import LiquidBridge, liquid_bridge
from demcore.geometry.wall_arrays import wall_arrays
from demcore.geometry.walls import Wall
from demcore.particles import spheres
from demcore.simulation import Simulation
from demcore.time_step import time_step
from tests.demcore.contact.registered import generator, pair

RADIUS, DENSITY, YOUNGS, G = 0.001, 2500.0, 1e6, 9.81
MASS = DENSITY * 4.0 / 3.0 * math.pi * RADIUS**3
WEIGHT = MASS * G


def hanging(cohesion, gravity, overlap=1e-7, friction=0.5, rolling=0.5):
    """A wet grain touching the plane z = 0 from above, with gravity in any direction."""
    contact = Interaction(0.5, friction, friction, rolling)
    return Simulation(
        spheres(np.array([[0.0, 0.0, RADIUS - overlap]]), np.array([RADIUS]), DENSITY),
        wall_arrays([Wall("plane")]),
        paper_model(cohesion=cohesion),
        uniform_table(Stiffness(YOUNGS, 0.25), contact),
        time_step(2 * RADIUS, DENSITY, YOUNGS, 0.5),
        gravity=np.array(gravity),
    )


def bridge(pull):
    """A liquid bridge that pulls a sphere of RADIUS to a wall with `pull`, N."""
    return LiquidBridge(pull / (4.0 * math.pi * RADIUS), 1.0)


@pytest.mark.parametrize(("share", "holds"), [(1.1, True), (0.9, False)])
def test_a_wet_grain_hangs_from_a_ceiling_while_the_bridge_is_stronger_than_its_weight(share, holds):
    # Gravity points away from the plane: the grain hangs.
    # It starts where a bridge that holds presses it: K_l s = pull - weight, K_l = E R at a wall.
    overlap = max((share - 1.0) * WEIGHT / (YOUNGS * RADIUS), 1e-10)
    s = hanging(bridge(share * WEIGHT), (0.0, 0.0, G), overlap)
    s.advance(round(0.1 / s.dt))
    assert (s.particles.state[0, 2] < RADIUS) == holds
    if not holds:
        # It touched for a moment and then falls freely.
        assert s.particles.state[0, 6] == pytest.approx(G * 0.1, rel=0.1)


@pytest.mark.parametrize(("friction", "holds"), [(0.55, True), (0.45, False)])
def test_what_clings_is_held_by_friction(friction, holds):
    # A vertical wall, pull twice the weight: friction of the pressing force carries it when mu > 1/2.
    s = hanging(bridge(2.0 * WEIGHT), (G, 0.0, 0.0), 2.0 * WEIGHT / (YOUNGS * RADIUS), friction, rolling=5.0)
    s.advance(round(0.2 / s.dt))
    slipped = s.particles.state[0, 0]
    assert s.particles.state[0, 2] < RADIUS
    assert (slipped < 0.01 * RADIUS) == holds


def test_a_linear_cohesion_softens_the_contact():
    # At rest K_l s - k 2 pi R s = weight; K_l = E R at a wall.
    density = 0.25 * YOUNGS / (2.0 * math.pi)
    s = hanging(LinearCohesion(density), (0.0, 0.0, -G))
    s.advance(round(1.0 / s.dt))
    expected = WEIGHT / (YOUNGS * RADIUS - density * 2.0 * math.pi * RADIUS)
    # The hysteretic spring stops on any unloading branch below the loading line; ringing leaves it near the line.
    assert RADIUS - s.particles.state[0, 2] == pytest.approx(expected, rel=0.25)
    assert RADIUS - s.particles.state[0, 2] > 1.1 * WEIGHT / (YOUNGS * RADIUS)


def test_the_published_forms():
    p = pair(generator(1))
    # Two equal water-wet spheres of radius 1 mm: 2 pi r gamma (Fisher 1926).
    equal = p._replace(radius=0.0005)
    assert liquid_bridge(LiquidBridge(0.072, 1.0), equal, 1e-6) == pytest.approx(
        2.0 * math.pi * 0.001 * 0.072, rel=1e-14
    )
    # The circle in which two spheres of radius r at distance d = 2 r - s cut each other: pi (r^2 - d^2/4).
    r, s = 0.01, 1e-5
    area = math.pi * (r * r - (2.0 * r - s) ** 2 / 4.0)
    touching = p._replace(radius=r / 2.0)
    assert linear_cohesion(LinearCohesion(3e5), touching, s) == pytest.approx(3e5 * area, rel=s / r)

"""The charging plant's belt: where it throws a small grain, and whether it carries the rate that it is fed.

Notation as in belts.py and plant/jet.py.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from demcore.case import Interaction, Stiffness
from demcore.case_run import CaseRun
from demcore.contact.laws import paper_model
from demcore.experiments.charge_case import ChargeTest, load_charge
from demcore.experiments.charge_run import BELT, places_of
from demcore.geometry.wall_arrays import wall_arrays
from demcore.material import SizeClass, SizeDistribution
from demcore.particles import VX, VZ, M, R, X, Z, spheres
from demcore.plant import jet
from demcore.plant.plant_file import load_plant
from demcore.plant.surfaces import BELT as BELT_WALL
from demcore.plant.surfaces import DRUM, plant_walls
from demcore.simulation import Simulation
from demcore.time_step import time_step
from demcore.verification.belts import Grip
from demcore.verification.outcome import SECTION_3, Outcome, share_of
from demcore.verification.single_sphere import DENSITY, POISSON, YOUNGS, G, sphere_mass, state

GRAIN = 0.002
# The grain starts so far before the drum, m, and its fall is followed for so long, s.
START, FALL = 0.1, 0.3
# Of the rate: grains of one size, so light that the account's rows of .1 s are even to a part in a thousand.
ONE_SIZE, LIGHT_RATE, FED_SECONDS = 0.05, 10.0, 6.0


def plant_jet() -> Iterator[Outcome]:
    """A small grain that grips leaves the plant's drum 32.4 degrees past the top, then follows a parabola."""
    plant = load_plant()
    belt = plant.belt
    contact = Interaction(0.24, 0.0, 0.0, 10.0)
    stiffness = (Stiffness(YOUNGS, POISSON),) * 2
    walls = [wall for wall in plant_walls(plant) if wall.name in (BELT_WALL, DRUM)]
    load = sphere_mass(GRAIN) * G * math.cos(math.radians(belt.tilt_deg))
    lift = GRAIN - load / (YOUNGS * GRAIN)
    place = np.array(belt.tangent_point) - START * np.array(belt.running) + lift * np.array(belt.normal)
    s = Simulation(
        spheres(
            np.array([place]), np.array([GRAIN]), DENSITY, velocity=belt.speed * np.array([belt.running])
        ),
        wall_arrays(walls),
        paper_model(),
        Grip(stiffness, ((contact,) * 2,) * 2),
        time_step(2 * GRAIN, DENSITY, YOUNGS, 0.24),
        gravity=np.array([0.0, 0.0, -G]),
    )
    cx, _, cz = belt.drum_centre
    angle, left = -math.inf, math.inf
    while s.time < left + FALL:
        s.advance(20)
        x, z = state(s, X) - cx, state(s, Z) - cz
        if math.hypot(x, z) < belt.outer_radius + GRAIN:
            angle, left = math.degrees(math.atan2(x, z)), s.time
        if s.time > 1.0:
            break
    expected = jet.release(belt, GRAIN)
    fx, fz = jet.position(expected, s.time - left)
    yield Outcome("charging plant, jet: leaves / deg past the top", SECTION_3, 32.4, angle, 1.0)
    # One degree of the drum.
    tolerance = math.radians(belt.outer_radius)
    yield Outcome(
        "charging plant, jet: x .3 s later / m", "parabola (plant/jet.py)", fx, state(s, X), tolerance
    )
    yield Outcome(
        "charging plant, jet: z .3 s later / m", "parabola (plant/jet.py)", fz, state(s, Z), tolerance
    )
    speed = math.hypot(state(s, VX), state(s, VZ) + G * (s.time - left))
    yield share_of("charging plant, jet: speed at release / m/s", "belt's speed", 1.79, speed, 0.01)


def belt_rate() -> Iterator[Outcome]:
    """The belt carries the rate that it is fed to within 1 %, and every grain is somewhere."""
    coke = load_charge("coke")
    sizes = SizeDistribution((SizeClass(ONE_SIZE, ONE_SIZE, 1.0),))
    material = replace(coke.material, sizes=sizes)
    charge = replace(coke, material=material, rate=LIGHT_RATE, duration=FED_SECONDS)
    test = ChargeTest(charge, load_plant(), scale=1.0, rest_seconds=0.5)
    run = CaseRun(test.case)
    s, rows = run.simulation, []
    while s.time < FED_SECONDS:
        s.advance(run.steps_to_event())
        run.act()
        if s.step % run.check_steps == 0:
            grains = s.particles.state
            on = places_of(grains[:, X : Z + 1], grains[:, R], test.plant) == BELT
            rows.append((s.time, run.accounts[0].born_kg - float(grains[on, M].sum())))
    time, left = np.array([row for row in rows if row[0] > 1.5 * test.plant.belt.ride_seconds]).T
    rate = float(np.polyfit(time, left, 1)[0])
    yield share_of("charging plant, belt: rate / kg/s", "the set rate", LIGHT_RATE, rate, 0.01)
    grain = sphere_mass(0.5 * ONE_SIZE) / DENSITY * material.particle_density
    due = min(LIGHT_RATE * s.time, charge.mass)
    yield Outcome("charging plant, belt: fed / kg", "rate times time", due, run.accounts[0].born_kg, grain)

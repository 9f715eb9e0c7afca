"""Beverloo's law: mass flows through a round hole as (D - k d)^(5/2).

Source: Beverloo, Leniger and van de Velde 1961, k = 1.4 (spheres). D hole, d mean particle diameter. The bed is
settled once; each hole is opened under a copy of it.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator

import numpy as np

from demcore.case import Interaction
from demcore.geometry.wall_arrays import wall_arrays
from demcore.geometry.walls import Wall
from demcore.particles import M
from demcore.simulation import Simulation
from demcore.verification.beds import column, fall_time, run_to_rest
from demcore.verification.outcome import SECTION_3, Outcome

DIAMETER = 0.01
TUBE = 8.0 * DIAMETER
COUNT = 3000
HOLES = (4.5, 5.5, 6.5, 8.0)
EMPTY_ANNULUS = 1.4
YOUNGS = 5e6
# Steady after a tenth of a second; watched until a third of the bed is out, or for LONGEST s.
START, LONGEST, MOST_OUT = 0.1, 0.6, 0.33


def settled_bed() -> tuple[Simulation, Wall]:
    """A bed at rest in a tube on a closed floor."""
    radius = 0.5 * DIAMETER * np.random.default_rng(14).uniform(0.9, 1.1, COUNT)
    side = Wall("cylinder", (0.0, 0.0, -0.01), radius=TUBE, length=2.0)
    floor = Wall("disc", radius=1.2 * TUBE)
    s = column(radius, TUBE, 14, [floor, side], Interaction(0.5, 0.5, 0.45, 0.1), youngs=YOUNGS)
    run_to_rest(s, fall_time(s) + 0.1, 4.0, rest_speed=0.02)
    return s, side


def flow_rate(settled: Simulation, side: Wall, hole: float) -> float:
    """kg/s through a hole of diameter `hole`, m; particles are counted DIAMETER below the floor."""
    s = copy.deepcopy(settled)
    s.walls = wall_arrays([Wall("disc", radius=1.2 * TUBE, inner_radius=hole / 2.0), side])
    s.stale = True
    whole = _above(s)
    s.advance(round(START / s.dt))
    begin, mass = s.time, _above(s)
    while s.time - begin < LONGEST and _above(s) > (1.0 - MOST_OUT) * whole:
        s.advance(200)
    return (mass - _above(s)) / (s.time - begin)


def _above(s: Simulation) -> float:
    """Mass that has not fallen through, kg."""
    state = s.particles.state
    return float(state[state[:, 2] > -DIAMETER, M].sum())


def beverloo() -> Iterator[Outcome]:
    """Exponent of the flow over D - 1.4 d, fitted over four holes."""
    s, side = settled_bed()
    rates = [flow_rate(s, side, hole * DIAMETER) for hole in HOLES]
    exponent = np.polyfit(np.log(np.array(HOLES) - EMPTY_ANNULUS), np.log(rates), 1)[0]
    yield Outcome("Beverloo exponent, round hole", SECTION_3, 2.5, float(exponent), 0.25)

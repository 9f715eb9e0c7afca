"""Janssen's law: the walls of a tall column carry what is added on top.

Source: Janssen 1895. The load on the floor of a bed of weight W is W_s (1 - exp(-W/W_s)) with the saturation
W_s = (W/H) R/(2 K mu), H height, R radius of the tube, mu the friction that the wall mobilises, K the ratio of
the stress on the wall to the vertical stress. The tube creeps upwards, so that friction is mobilised all along.

K mu is measured on its own, not fitted to the loads: the wall's shear stress over the vertical stress, slice by
slice of the tallest column, where the vertical stress is what hangs above a slice less what the wall carries.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np

from demcore.case import Interaction
from demcore.geometry.walls import Wall
from demcore.particles import Floats, M, R, Z
from demcore.simulation import Simulation
from demcore.verification.beds import G, column, fall_time, run_to_rest, wall_push
from demcore.verification.outcome import Outcome, share_of

SOURCE = "Janssen 1895"
DIAMETER = 0.01
TUBE = 3.5 * DIAMETER
COUNTS = (200, 400, 700, 1100, 1600)
CREEP = 0.02
YOUNGS = 5e6
FLOOR, WALL = 0, 1


def settled_column(count: int) -> Simulation:
    """A column at rest in a rough tube that has crept up by half a diameter, and still does."""
    radius = 0.5 * DIAMETER * np.random.default_rng([13, count]).uniform(0.9, 1.1, count)
    contact = Interaction(0.5, 0.4, 0.4, 0.0)
    walls = [
        Wall("plane"),
        Wall("cylinder", (0.0, 0.0, -0.1), radius=TUBE, length=200.0 * DIAMETER, velocity=(0.0, 0.0, CREEP)),
    ]
    s = column(radius, TUBE, count, walls, contact, youngs=YOUNGS)
    run_to_rest(s, fall_time(s) + 0.2, 5.0, rest_speed=0.1)
    s.advance(round(0.5 * DIAMETER / CREEP / s.dt))
    return s


def loads(s: Simulation) -> tuple[float, Floats, Floats]:
    """Load on the floor (N), and by particle, in the order of their numbers, heights (N,) and the tube's upward
    pull (N,); means over .3 s."""
    floor, pull = 0.0, np.zeros(s.count)
    times = 60
    for _ in range(times):
        s.advance(round(0.005 / s.dt))
        floor += float(wall_push(s, FLOOR)[:, 2].sum()) / times
        pull += wall_push(s, WALL)[:, 2] / times
    return floor, s.particles.state[np.argsort(s.particles.number), Z], pull


def shear_ratio(height: Floats, pull: Floats, mass: Floats) -> float:
    """K mu: shear stress on the wall over vertical stress, least squares over slices of the column (no end)."""
    top = float(np.quantile(height, 0.98))
    edges = np.linspace(3.0 * DIAMETER, top - 3.0 * DIAMETER, 9)
    shear, vertical = [], []
    for low, high in itertools.pairwise(edges):
        inside = (height >= low) & (height < high)
        above = height >= 0.5 * (low + high)
        shear.append(pull[inside].sum() / (2.0 * math.pi * TUBE * (high - low)))
        vertical.append((G * mass[above] - pull[above]).sum() / (math.pi * TUBE**2))
    return float(np.dot(shear, vertical) / np.dot(vertical, vertical))


def fitted_saturation(weight: Floats, load: Floats) -> float:
    """W_s that fits load = W_s (1 - exp(-W/W_s)) best, by a search over a fine scale."""
    trial = np.geomspace(0.05, 20.0, 4000) * float(weight.max())
    expected = trial[:, None] * (1.0 - np.exp(-weight / trial[:, None]))
    return float(trial[np.argmin(((expected - load) ** 2).sum(axis=1))])


def janssen() -> Iterator[Outcome]:
    """Loads of five columns follow one saturation, and it is the one that K mu of the tallest predicts."""
    weights, floors, ratio, per_metre = [], [], 0.0, 0.0
    for count in COUNTS:
        s = settled_column(count)
        floor, height, pull = loads(s)
        rows = s.particles.state[np.argsort(s.particles.number)]
        weights.append(G * float(rows[:, M].sum()))
        floors.append(floor)
        if count == COUNTS[-1]:
            ratio = shear_ratio(height, pull, rows[:, M])
            per_metre = weights[-1] / float(np.quantile(height + rows[:, R], 0.98))
    saturation = fitted_saturation(np.array(weights), np.array(floors))
    predicted = per_metre * TUBE / (2.0 * ratio)
    yield share_of("Janssen: saturation of the floor's load / N", SOURCE, predicted, saturation, 0.15)
    for weight, load in zip(weights, floors, strict=True):
        expected = saturation * (1.0 - math.exp(-weight / saturation))
        name = f"Janssen: load on the floor under {weight:.2f} N"
        yield Outcome(name, SOURCE, expected, load, 0.15 * saturation)

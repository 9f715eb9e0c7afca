"""A pile test under way: fill, settle, remove the cylinder at once, discharge, rest.

Source: the paper's section 2.1.3 (instant removal, limited base, Table 2's rigs). What the paper leaves open is
a named choice here: the fill is by mass (bulk density times the cylinder's volume times `fill_level`), the
cylinder's wall reaches as high as the loose column while it falls in, and a bed is at rest when its rms speed
stays below REST_SPEED sqrt(g d) for REST_TIME.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from demcore import checkpoint
from demcore.contact.laws import paper_model
from demcore.errors import NeverSettles
from demcore.experiments.pile_case import PileTest, material_table
from demcore.forces import Neighbours
from demcore.geometry.wall_arrays import wall_arrays
from demcore.geometry.wall_rows import Walls
from demcore.geometry.walls import Wall
from demcore.insertion import fill_cylinder
from demcore.material import coarse_grain
from demcore.particles import VX, VZ, M, Particles, R, Z, spheres
from demcore.simulation import Simulation
from demcore.wall_list import WallList

REST_SPEED = 0.005
REST_TIME = 0.1
FLOOR = -0.1
LONGEST_SETTLE = 4.0
LONGEST_DISCHARGE = 12.0
# Simulated seconds that a discharge usually takes; for the time left only.
USUAL_DISCHARGE = 3.0
CYLINDER = 1


def _fill(test: PileTest) -> Particles:
    """The loose column above the base, its mass right to one particle."""
    material, rig = test.material, test.rig
    rng = np.random.default_rng([20210, test.seed])
    sizes = coarse_grain(material.sizes, test.scale)
    volume = math.pi * rig.cylinder_radius**2 * rig.cylinder_height * test.fill_level
    grain = material.particle_density * math.pi / 6.0 * sizes.number_mean_cube
    count = max(1, round(material.bulk_density * volume / grain))
    radius = sizes.sample(count, rng) / 2.0
    shares = np.cumsum([m.mass_share for m in material.wall_restitution])
    rows = np.minimum(np.searchsorted(shares, rng.random(count), side="right"), len(shares) - 1) + 1
    position = fill_cylinder(radius, rig.cylinder_radius, rng)
    return spheres(position, radius, material.particle_density, rows.astype(np.int32))


def _walls(test: PileTest, top: float) -> Walls:
    return wall_arrays(
        [
            Wall("disc", radius=test.rig.base_radius),
            Wall("cylinder", radius=test.rig.cylinder_radius, length=top),
        ]
    )


class PileRun:
    """A pile test under way: the simulation and the few numbers of its program, all of them resumable."""

    def __init__(self, test: PileTest, threaded: bool) -> None:
        self.test = test
        particles = _fill(test)
        top = float((particles.state[:, Z] + particles.state[:, R]).max()) + test.scale * 0.01
        self.simulation = Simulation(
            particles,
            _walls(test, top),
            paper_model(test.material.long_term_damping),
            material_table(test.material, test.parameters),
            test.dt,
            floor=FLOOR,
            reach=4.0 * test.rig.base_radius,
            threaded=threaded,
        )
        self.phase = "settle"
        self.initial = particles.state[:, [R, M]].copy()
        self.least_settle = math.sqrt(2.0 * top / 9.81)
        self.removed_at = 0
        self.rest_since = -1
        self.fill_height = 0.0
        self.particle_steps = 0
        self.wall_seconds = 0.0

    NUMBERS = ("phase", "removed_at", "rest_since", "fill_height", "particle_steps", "wall_seconds")

    def save(self, path: Path) -> None:
        """Everything between two steps, neighbour list and histories included."""
        s = self.simulation
        numbers = {name: getattr(self, name) for name in self.NUMBERS}
        numbers |= {
            "identity": self.test.identity(),
            "step": s.step,
            "searches": s.searches,
            "stale": s.stale,
        }
        arrays: dict[str, NDArray[Any]] = {
            "left": np.array(s.left, np.int64).reshape(-1, 2),
        }
        for group, record in (
            ("p", s.particles),
            ("n", s.neighbours),
            ("w", s.walls),
            ("near", s.near_walls),
        ):
            arrays |= {f"{group}_{name}": value for name, value in record._asdict().items()}
        checkpoint.save(path, numbers, arrays)

    def resume(self, path: Path) -> bool:
        """Take over the newest whole checkpoint of this very test; False when there is none."""
        stored = checkpoint.load_newest(path)
        if stored is None or stored[0]["identity"] != self.test.identity():
            return False
        numbers, arrays = stored
        for name in self.NUMBERS:
            setattr(self, name, numbers[name])
        s = self.simulation
        s.step, s.searches, s.stale = numbers["step"], numbers["searches"], numbers["stale"]
        s.left = [(int(number), int(step)) for number, step in arrays["left"]]
        s.particles = Particles(*(arrays[f"p_{name}"] for name in Particles._fields))
        s.neighbours = Neighbours(*(arrays[f"n_{name}"] for name in Neighbours._fields))
        s.near_walls = WallList(*(arrays[f"near_{name}"] for name in WallList._fields))
        s.walls = Walls(*(arrays[f"w_{name}"] for name in Walls._fields))
        return True

    def is_at_rest(self) -> bool:
        """rms speed below REST_SPEED sqrt(g d), d the mean diameter."""
        state = self.simulation.particles.state
        if len(state) == 0:
            return True
        speed = math.sqrt(
            float((state[:, M] * (state[:, VX : VZ + 1] ** 2).sum(axis=1)).sum() / state[:, M].sum())
        )
        diameter = self.test.material.sizes.mean_diameter * self.test.scale
        return speed < REST_SPEED * math.sqrt(9.81 * diameter)

    def phase_time(self) -> float:
        """Seconds since the fill or since the cylinder vanished."""
        start = 0 if self.phase == "settle" else self.removed_at
        return (self.simulation.step - start) * self.simulation.dt

    def check(self) -> bool:
        """Called every CHECK_INTERVAL of simulated time: rest, phase change, limits. True when finished."""
        s = self.simulation
        s.check_overlaps()
        least = self.least_settle if self.phase == "settle" else 0.3
        if self.is_at_rest() and self.phase_time() >= least:
            if self.rest_since < 0:
                self.rest_since = s.step
        else:
            self.rest_since = -1
        rested = self.rest_since >= 0 and (s.step - self.rest_since) * s.dt >= REST_TIME
        if self.phase == "settle":
            if rested:
                self._remove_cylinder()
            elif self.phase_time() > self.least_settle + LONGEST_SETTLE:
                raise NeverSettles(f"the filled bed still moves after {self.phase_time():.1f} s")
            return False
        if not rested and self.phase_time() > LONGEST_DISCHARGE:
            raise NeverSettles(f"the pile still moves {self.phase_time():.1f} s after the cylinder vanished")
        return rested

    def _remove_cylinder(self) -> None:
        s = self.simulation
        state = s.particles.state
        # Level of the bed: its surface is rough, so the 95 % quantile of the tops rather than the highest one.
        self.fill_height = float(np.quantile(state[:, Z] + state[:, R], 0.95)) if len(state) else 0.0
        s.remove_wall(CYLINDER)
        self.phase, self.removed_at, self.rest_since = "discharge", s.step, -1

    def fraction(self) -> float:
        """Rough share of the work done: the settling bed is larger, the discharge longer."""
        if self.phase == "settle":
            return 0.4 * min(1.0, self.phase_time() / (self.least_settle + 0.5))
        return 0.4 + 0.6 * (1.0 - math.exp(-2.0 * self.phase_time() / USUAL_DISCHARGE))

"""The paper's conical pile test as a program: fill, settle, remove the cylinder at once, discharge, rest.

Source: the paper's section 2.1.3 (instant removal, limited base, Table 2's rigs). What the paper leaves open is
a named choice here: the fill is by mass (bulk density times the cylinder's volume times `fill_level`), the
cylinder's wall reaches as high as the loose column while it falls in, and a bed is at rest when its rms speed
stays below REST_SPEED sqrt(g d) for REST_TIME.
"""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from demcore import checkpoint
from demcore.case import Interaction, MaterialTable, Stiffness
from demcore.contact.laws import paper_model
from demcore.errors import Cancelled, InputError, NeverSettles, NoResult
from demcore.experiments.pile_result import PileResult, measure_pile
from demcore.forces import Neighbours, Walls
from demcore.geometry.walls import Wall
from demcore.insertion import fill_cylinder
from demcore.material import Material, coarse_grain
from demcore.particles import VX, VZ, M, Particles, R, Z, spheres
from demcore.rig import Rig
from demcore.simulation import Simulation, wall_arrays
from demcore.time_step import PRESETS, time_step

REST_SPEED = 0.005
REST_TIME = 0.1
CHECK_INTERVAL = 0.01
FLOOR = -0.1
LONGEST_SETTLE = 4.0
LONGEST_DISCHARGE = 12.0
# Simulated seconds that a discharge usually takes; for the time left only.
USUAL_DISCHARGE = 3.0
WALL_CLOCK_CHUNK = 0.2
BASE, CYLINDER = 0, 1


@dataclass(frozen=True)
class ContactParameters:
    """The paper's four variables (Table 5), dimensionless."""

    particle_particle_static_friction: float
    particle_wall_static_friction: float
    particle_particle_restitution: float
    rolling_resistance: float

    def __post_init__(self) -> None:
        for name, lower, upper in (
            ("particle_particle_static_friction", 0.0, 10.0),
            ("particle_wall_static_friction", 0.0, 10.0),
            ("particle_particle_restitution", 0.05, 1.0),
            ("rolling_resistance", 0.0, 10.0),
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and lower <= value <= upper):
                raise InputError(name, value, f"{lower:g} to {upper:g}")


@dataclass(frozen=True)
class PileTest:
    """One virtual experiment. `scale` multiplies the sizes, `fill_level` the filled height of the cylinder;
    `time_step` is a preset, `time_step_factor` shortens it after a blow-up."""

    material: Material
    rig: Rig
    parameters: ContactParameters
    scale: float = 1.0
    seed: int = 1
    fill_level: float = 1.0
    time_step: str = "fast"
    time_step_factor: float = 1.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.scale) and 0.1 <= self.scale <= 20.0):
            raise InputError("scale", self.scale, "0.1 to 20")
        if not (math.isfinite(self.fill_level) and 0.05 <= self.fill_level <= 1.0):
            raise InputError("fill_level", self.fill_level, "0.05 to 1")
        if self.time_step not in PRESETS:
            raise InputError("time_step", self.time_step, " or ".join(PRESETS))
        if not 0.0 < self.time_step_factor <= 1.0:
            raise InputError("time_step_factor", self.time_step_factor, "more than 0, at most 1")
        largest = self.material.sizes.largest * self.scale
        if largest > self.rig.cylinder_radius:
            raise InputError(
                "scale",
                self.scale,
                f"at most {self.rig.cylinder_radius / self.material.sizes.largest:.2g} for this rig, so that "
                "two of the largest particles fit across the cylinder",
            )

    @property
    def dt(self) -> float:
        """Time step, s, for the smallest particles and the smallest restitution in the test."""
        sizes = coarse_grain(self.material.sizes, self.scale)
        restitution = min(
            self.parameters.particle_particle_restitution, *(m.value for m in self.material.wall_restitution)
        )
        step = time_step(
            sizes.smallest,
            self.material.particle_density,
            self.material.youngs_modulus,
            restitution,
            self.time_step,
        )
        return step * self.time_step_factor

    @property
    def diameters_across_base(self) -> float:
        """Mean diameters along the base radius: below 12 the angle feels the particles (physics.md 4)."""
        return self.rig.base_radius / (self.material.sizes.mean_diameter * self.scale)

    def identity(self) -> str:
        """JSON of every input: a checkpoint of another test is not resumed."""
        return json.dumps(dataclasses.asdict(self), sort_keys=True)


@dataclass(frozen=True)
class Progress:
    """What a run reports a few times a second. Times in s; fraction of the work done is an estimate."""

    phase: str
    time_s: float
    particles: int
    kinetic_energy_j: float
    particle_steps_per_s: float
    fraction: float
    seconds_left: float


OnProgress = Callable[[Progress], bool]


def material_table(material: Material, parameters: ContactParameters) -> MaterialTable:
    """Row 0 the walls, one row of grains per wall restitution; dynamic friction is a share of static."""
    p, ratio = parameters, material.dynamic_friction_ratio
    grains = Interaction(
        p.particle_particle_restitution,
        p.particle_particle_static_friction,
        ratio * p.particle_particle_static_friction,
        p.rolling_resistance,
    )
    steel = [
        Interaction(
            mix.value,
            p.particle_wall_static_friction,
            ratio * p.particle_wall_static_friction,
            p.rolling_resistance,
        )
        for mix in material.wall_restitution
    ]
    rows = len(steel) + 1
    table = [[grains] * rows for _ in range(rows)]
    for k, contact in enumerate(steel, start=1):
        table[0][k] = table[k][0] = contact
    stiffness = Stiffness(material.youngs_modulus, material.poisson_ratio)
    return MaterialTable((stiffness,) * rows, tuple(tuple(row) for row in table))


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
            "wall_way": s.wall_way,
            "left": np.array(s.left, np.int64).reshape(-1, 2),
        }
        for group, record in (("p", s.particles), ("n", s.neighbours), ("w", s.walls)):
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
        s.wall_way = arrays["wall_way"]
        s.left = [(int(number), int(step)) for number, step in arrays["left"]]
        s.particles = Particles(*(arrays[f"p_{name}"] for name in Particles._fields))
        s.neighbours = Neighbours(*(arrays[f"n_{name}"] for name in Neighbours._fields))
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


def run_pile_test(
    test: PileTest,
    on_progress: OnProgress | None = None,
    threads: int = 1,
    checkpoint_path: Path | None = None,
    checkpoint_seconds: float = 30.0,
) -> PileResult:
    """Run the test and measure the pile; same test and seed, same bits, on any number of threads.

    `on_progress` is called a few times a second and stops the run by returning False. With `checkpoint_path` the
    run saves itself every `checkpoint_seconds` and continues from there when called again.
    Raises Cancelled, BlowUp, NeverSettles or NoResult (demcore.errors).
    """
    run = PileRun(test, threaded=threads > 1)
    if checkpoint_path is not None:
        run.resume(checkpoint_path)
    _drive(run, on_progress, checkpoint_path, checkpoint_seconds)
    if run.simulation.count == 0:
        raise NoResult("every particle left the base: no pile to measure")
    return measure_pile(run)


def _drive(run: PileRun, on_progress: OnProgress | None, path: Path | None, seconds: float) -> None:
    """Advance in chunks of about WALL_CLOCK_CHUNK seconds until the pile is at rest."""
    s = run.simulation
    interval = max(1, round(CHECK_INTERVAL / s.dt))
    chunk, rate = 50, 0.0
    before, saved = run.wall_seconds, time.monotonic()
    started = saved
    while True:
        steps = min(chunk, interval - s.step % interval)
        clock, count = time.perf_counter(), s.count
        s.advance(steps)
        spent = time.perf_counter() - clock
        run.particle_steps += steps * count
        run.wall_seconds = before + time.monotonic() - started
        if spent > 0.0:
            rate = steps * count / spent
            chunk = max(1, min(interval, int(steps * WALL_CLOCK_CHUNK / spent)))
        finished = s.step % interval == 0 and run.check()
        if on_progress is not None and not on_progress(_report(run, rate)):
            raise Cancelled(f"stopped on request at {s.time:.3f} s")
        if finished:
            return
        if path is not None and time.monotonic() - saved >= seconds:
            run.save(path)
            saved = time.monotonic()


def _report(run: PileRun, rate: float) -> Progress:
    s, done = run.simulation, run.fraction()
    left = run.wall_seconds * (1.0 - done) / done if done > 0.02 else math.nan
    return Progress(run.phase, s.time, s.count, s.kinetic_energy, rate, done, left)

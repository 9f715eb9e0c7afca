"""A case under way: the simulation, its feeds, and the plan that says what happens and when it is over.

Everything here happens at whole steps that the case alone fixes (checks every CHECK_INTERVAL, feeds at theirs),
never by the clock; so a run gives the same bits however it is cut into chunks, saved and resumed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from demcore import checkpoint
from demcore.case import Case
from demcore.contact.coulomb_spring import CoulombSpring
from demcore.contact.hertz import Hertz
from demcore.contact.hysteretic_spring import HystereticLinearSpring
from demcore.contact.laws import DRY, VACUUM
from demcore.contact.liquid_bridge import LiquidBridge
from demcore.contact.mindlin_spring import MindlinSpring
from demcore.contact.model import ContactModel
from demcore.contact.still_air import StillAir
from demcore.contact.type3_rolling import Type3Rolling
from demcore.contact.velocity_hysteretic_spring import VelocityHystereticSpring
from demcore.feeding import FeedAccount, Feeder
from demcore.geometry.wall_arrays import wall_arrays
from demcore.geometry.wall_rows import Walls
from demcore.identity import run_identity
from demcore.insertion import fill_region
from demcore.particles import Floats, Particles, R, X, Z, join, nothing, spheres
from demcore.rest import RestWatch
from demcore.sampling import bulk_density, components, draw_mass
from demcore.simulation import Simulation

# Simulated seconds between two looks at the bed: rest, health, history.
CHECK_INTERVAL = 0.01
# First words of the random streams of fills and feeds.
FILLS, FEEDS = 1, 2


class Reading(NamedTuple):
    """The bed at a check: time s, particles, kinetic energy J, mass kg."""

    time: float
    particles: int
    kinetic_energy: float
    mass: float


class Plan(Protocol):
    """What a program adds to a case: phases, what it does at a check, and when it is over.

    A plan depends on the run's state alone, and `numbers` is all of its own state (JSON-able).
    """

    phase: str

    def check(self, run: CaseRun) -> str | None:
        """Called at every check; may change walls; why the run is over, None while it is not."""

    def fraction(self, run: CaseRun) -> float:
        """Rough share of the work done, 0 to 1, never falling."""

    def numbers(self) -> dict[str, Any]:
        """State to save."""

    def restore(self, numbers: Mapping[str, Any]) -> None:
        """State from a checkpoint."""


class UntilRest:
    """The plan of a bare case: until its duration is over, or all has come and lies still, or nothing is left."""

    phase = "run"

    def __init__(self, case: Case) -> None:
        self._watch = None if case.rest is None else RestWatch(case.rest, case.strength_of_gravity)

    def check(self, run: CaseRun) -> str | None:
        """`rest`, `empty` or `duration`."""
        complete = run.is_complete
        if self._watch is not None and self._watch.look(run.simulation, complete) and run.simulation.count:
            return "rest"
        if run.simulation.count == 0 and run.is_fed:
            return "empty"
        return "duration" if run.simulation.step >= run.last_step else None

    def fraction(self, run: CaseRun) -> float:
        """Share of the simulated time."""
        return min(1.0, run.simulation.step / run.last_step)

    def numbers(self) -> dict[str, Any]:
        """When the bed came to lie still."""
        return {"rest_since": -1 if self._watch is None else self._watch.since}

    def restore(self, numbers: Mapping[str, Any]) -> None:
        """As `numbers` says."""
        if self._watch is not None:
            self._watch.since = numbers["rest_since"]


def contact_model(case: Case) -> ContactModel:
    """The laws that a case names, with its numerics."""
    n = case.numerics
    rolling = Type3Rolling(1.0 if n.rolling else 0.0)
    water, air = case.water, case.air
    cohesion = DRY if water is None else LiquidBridge(water.surface_tension, water.wetting)
    field = VACUUM if air is None else StillAir(air.density, air.viscosity)
    if case.contact_model == "hertz_mindlin":
        mindlin = MindlinSpring(n.creep_speed)
        return ContactModel(Hertz(1.0 if n.limit_force else 0.0), mindlin, rolling, cohesion, field)
    shared = n.residual, case.long_term_damping, n.aged_after
    normal: HystereticLinearSpring | VelocityHystereticSpring = HystereticLinearSpring(*shared)
    if n.restitution_exponent:
        normal = VelocityHystereticSpring(*shared, exponent=n.restitution_exponent)
    return ContactModel(normal, CoulombSpring(n.stiffness_ratio, n.creep_speed), rolling, cohesion, field)


def fill_all(case: Case, walls: Walls) -> Particles:
    """The particles of all fills, numbered from 0. Raises InputError for a fill that its region cannot hold."""
    bed = nothing()
    for k, fill in enumerate(case.fills):
        rng = np.random.default_rng([case.seed, FILLS, k, fill.seed])
        mass = fill.mass
        if mass is None:
            assert fill.level is not None, "a fill has a mass or a level"
            mass = bulk_density(fill.mix, case.grains) * fill.region.volume_below(fill.level)
        draw = draw_mass(components(fill.mix, case.grains, case.rows), mass, rng)
        taken = bed.state[:, X : Z + 1], bed.state[:, R]
        position = fill_region(fill.region, draw.radius, rng, walls, *taken)
        velocity = np.tile(np.array(fill.velocity), (len(position), 1))
        fresh = spheres(position, draw.radius, draw.density, draw.row, velocity)
        bed = join(bed, fresh, len(bed.number))
    return bed


class CaseRun:
    """A case between two steps; all of it can be saved and taken up again."""

    def __init__(
        self, case: Case, plan: Plan | None = None, threaded: bool = False, program: Any = None
    ) -> None:
        """`program` is what else, beside the case, the run's outcome depends on: part of its identity."""
        self.case = case
        self.plan: Plan = UntilRest(case) if plan is None else plan
        self.identity = run_identity(case, program)
        walls = wall_arrays(case.walls)
        bed = fill_all(case, walls)
        self.filled_kg = float(bed.state[:, 7].sum())
        self.filled = len(bed.number)
        self.simulation = Simulation(
            bed,
            walls,
            contact_model(case),
            case.table(),
            case.dt,
            gravity=np.array(case.gravity, float),
            domain=case.domain,
            threaded=threaded,
            skin=case.numerics.skin_share * case.smallest_radius,
            wall_names=tuple(wall.name for wall in case.walls),
            may_squeeze=case.numerics.may_squeeze,
            dormancy=case.dormancy,
        )
        self.feeders = [
            Feeder(feed, case.grains, case.rows, case.duration, (case.seed, FEEDS, k))
            for k, feed in enumerate(case.feeds)
        ]
        gravity = self.simulation.gravity
        self.feed_steps = max(
            1, math.floor(min((f.longest_interval(gravity) for f in self.feeders), default=1.0) / case.dt)
        )
        self.check_steps = max(1, round(CHECK_INTERVAL / case.dt))
        self.last_step = math.ceil(case.duration / case.dt)
        self.history: list[Reading] = []
        self.ended = ""
        self.wall_seconds = 0.0
        self._feed()
        self._read()

    @property
    def is_complete(self) -> bool:
        """Everything that is to come has come, and no wall has anything ahead that could wake a bed at rest."""
        return self.is_fed and self.simulation.time >= self.last_wall_event

    @property
    def is_fed(self) -> bool:
        """Every feed has ended and nobody waits."""
        return all(f.is_done for f in self.feeders)

    @cached_property
    def last_wall_event(self) -> float:
        """s, after which no wall appears, vanishes or moves (belts aside); inf when one moves for ever."""
        events = [0.0]
        for wall in self.case.walls:
            events += [t for t in (wall.from_time, wall.until_time) if math.isfinite(t)]
            if any(wall.velocity) or any(wall.angular_velocity) or wall.oscillation is not None:
                events.append(min(wall.moves_until, wall.until_time))
        return max(events)

    @property
    def accounts(self) -> tuple[FeedAccount, ...]:
        """What each feed was asked for and what came."""
        return tuple(f.account() for f in self.feeders)

    def steps_to_event(self) -> int:
        """Steps until something happens that is not the simulation's own."""
        step = self.simulation.step
        ahead = [self.check_steps - step % self.check_steps, self.last_step - step]
        if not self.is_fed:
            ahead.append(self.feed_steps - step % self.feed_steps)
        return max(1, min(ahead))

    def act(self) -> None:
        """What is due at this step. Raises BlowUp for a bed that is no longer sound; sets `ended`."""
        s = self.simulation
        if s.step % self.feed_steps == 0:
            self._feed()
        if s.step % self.check_steps == 0 or s.step >= self.last_step:
            s.check()
            self._read()
            self.ended = self.plan.check(self) or ""

    def _feed(self) -> None:
        s = self.simulation
        for feeder in self.feeders:
            if not feeder.is_done:
                born = feeder.births(s.step, s.dt, s.particles, s.walls, s.gravity)
                if born is not None:
                    s.add(born)

    def _read(self) -> None:
        s = self.simulation
        self.history.append(Reading(s.time, s.count, s.kinetic_energy, s.mass))

    def save(self, path: Path) -> None:
        """Everything between two steps. Raises BlowUp instead of keeping a bed that is not sound."""
        self.simulation.check()
        numbers, arrays = self.simulation.stored()
        numbers |= {
            "identity": self.identity,
            "phase": self.plan.phase,
            "plan": self.plan.numbers(),
            "filled": self.filled,
            "filled_kg": self.filled_kg,
            "wall_seconds": self.wall_seconds,
            "feed_next": [f.next for f in self.feeders],
        }
        arrays["history"] = np.array(self.history, np.float64).reshape(-1, len(Reading._fields))
        for k, feeder in enumerate(self.feeders):
            arrays[f"feed{k}_waiting"] = feeder.waiting
        checkpoint.save(path, numbers, arrays)

    def resume(self, path: Path) -> bool:
        """Take over the newest whole checkpoint of this very run; False when there is none.

        Warns of every file that was refused (checkpoint.CheckpointWarning).
        """
        stored = checkpoint.load_newest(path, self.identity)
        if stored is None:
            return False
        numbers, arrays = stored
        self.plan.phase = numbers["phase"]
        self.plan.restore(numbers["plan"])
        for name in ("filled", "filled_kg", "wall_seconds"):
            setattr(self, name, numbers[name])
        self._restore_feeds(numbers["feed_next"], arrays)
        rows: list[list[float]] = arrays["history"].tolist()
        self.history = [Reading(t, int(n), energy, mass) for t, n, energy, mass in rows]
        self.simulation.restore(numbers, arrays)
        return True

    def _restore_feeds(self, following: list[int], arrays: Mapping[str, NDArray[Any]]) -> None:
        for k, feeder in enumerate(self.feeders):
            feeder.next = following[k]
            feeder.waiting = arrays[f"feed{k}_waiting"]

    def by_number(self) -> tuple[NDArray[np.int64], Floats, NDArray[np.int32]]:
        """Numbers (N,), state rows (N, 12) and materials (N,), in the order of the particles' numbers."""
        p = self.simulation.particles
        order = np.argsort(p.number)
        return p.number[order], p.state[order], p.material[order]

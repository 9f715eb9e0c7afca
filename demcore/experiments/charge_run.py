"""The plan of a charge: run-up of the belt, the charge, rest; and what is watched on the way.

Where the mass is, by place alone: on the belt (upstream of where the jet leaves the drum), in flight, in the
hopper (under its lid, within its wall), lost (beside the hopper, on the lid, or gone from the domain). The run-up
ends when the bed on the belt is steady: its mass, averaged over the time that the belt takes from tail to drum,
has changed by less than STEADY of itself, or by less than the heaviest grain, from one such time to the next.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.case_run import CHECK_INTERVAL, CaseRun
from demcore.errors import NoResult
from demcore.experiments.charge_case import ChargeTest
from demcore.insertion import walls_at
from demcore.observables.belt_flow import BeltSection, JetEnvelope
from demcore.observables.burden import Bowl, scan_surface
from demcore.observables.wear import WearMap, find_loads, find_strikes
from demcore.particles import VX, VZ, Floats, M, R, X, Z
from demcore.plant import jet
from demcore.plant.parts import Plant

RUN_UP, CHARGE, REST = "run-up", "charge", "rest"
STEADY = 0.02
# Simulated seconds between two rows of the account, and between two readings of the hopper's level.
ACCOUNT_INTERVAL, LEVEL_EVERY = 0.1, 5
# The section is taken over this length of belt, so far before the trough begins to flatten, m.
SECTION_LENGTH, SECTION_GAP = 0.5, 0.1
SECTION_HEIGHT = 0.6
# The load of the burden on the walls is a mean over the last looks.
LOAD_LOOKS = 50
LEVELS = 10
# The jet is read so far above the ridge, m, and followed on in thought: below, grains rebound from the deflector.
AIM = 0.3


class Account(NamedTuple):
    """Where the mass is at a time, s; kg. `level`: mean height z of the burden's surface, m; nan between."""

    time: float
    fed: float
    on_belt: float
    in_flight: float
    in_hopper: float
    lost: float
    level: float

    @property
    def missing(self) -> float:
        """What went in less all that is somewhere, kg."""
        return self.fed - self.on_belt - self.in_flight - self.in_hopper - self.lost


BELT, FLIGHT, HOPPER, LOST = 0, 1, 2, 3


def bowl_of(plant: Plant) -> Bowl:
    """The hopper's inside from the rod to the rim, by the plant's numbers."""
    h = plant.hopper
    radius = np.array([plant.rod.radius, h.seat_radius, h.rim_radius])
    return Bowl(radius, np.array([plant.floor_at(float(r)) for r in radius[:2]] + [-h.cylinder_height]))


def places_of(position: Floats, radius: Floats, plant: Plant) -> NDArray[np.int64]:
    """BELT, FLIGHT, HOPPER or LOST of each grain; position (N, 3) m, radius (N,) m."""
    x, y, z = position.T
    belt, hopper = plant.belt, plant.hopper
    away = np.hypot(x, y)
    up = np.clip((z + hopper.seat_depth) / hopper.cone_height, 0.0, 1.0)
    wall = hopper.seat_radius + (hopper.rim_radius - hopper.seat_radius) * up
    place = np.full(len(x), FLIGHT)
    slope = (plant.hopper.rim_radius - away) / (plant.hopper.rim_radius - plant.lid.inner_radius)
    lid = plant.lid.height * np.clip(slope, 0.0, 1.0)
    below = z < lid
    # Soft walls let a centre come nearer than its radius, never to the wall itself. A heap may rise above the rim.
    place[below] = np.where((away < wall)[below] & (z > -hopper.seat_depth)[below], HOPPER, LOST)
    (x0, y0), (x1, y1) = plant.hatch.lower, plant.hatch.upper
    in_hatch = (x > x0) & (x < x1) & (y > y0) & (y < y1)
    place[~below & ~in_hatch & (away < hopper.rim_radius) & (z < lid + 1.2 * radius)] = LOST
    offset = position - np.array(belt.tangent_point)
    along, above = offset @ np.array(belt.running), offset @ np.array(belt.normal)
    angle = np.arctan2(x - belt.drum_centre[0], z - belt.drum_centre[2])
    round_drum = (along > 0.0) & (angle < math.radians(max(jet.release(belt).angle_deg, 0.0)))
    beside = np.abs(y - belt.drum_centre[1]) < 0.5 * belt.width + radius
    # A grain at the trough's edge still has its centre above the middle strip's plane.
    on = beside & (above > 0.0) & ((along <= 0.0) | round_drum)
    place[on] = BELT
    return place


class ChargePlan:
    """Phases, the account, and the sums of what was watched; all of it can be saved."""

    def __init__(self, test: ChargeTest) -> None:
        self.test, plant = test, test.plant
        self.phase = RUN_UP
        self.accounts: list[Account] = []
        self.steady_from = math.nan
        self.fed_at = math.nan
        self.section = BeltSection(0.5 * plant.belt.width, SECTION_HEIGHT)
        self.sampled = -math.inf
        lowest, highest = -0.5 * plant.hopper.seat_depth, plant.belt.drum_height
        levels = np.linspace(lowest, highest, LEVELS)
        levels[np.argmin(np.abs(levels - plant.deflector.ridge_height))] = plant.deflector.ridge_height
        self.jet = JetEnvelope(levels, plant.belt.drum_centre[0], plant.hopper.rim_radius)
        aimed_at = np.array([plant.deflector.ridge_height + AIM])
        self.aim = JetEnvelope(aimed_at, plant.belt.drum_centre[0], plant.hopper.rim_radius, AIM)
        self.wear = WearMap()
        self.bowl = bowl_of(plant)

    def check(self, run: CaseRun) -> str | None:
        """Keep the account and the watch; `complete` when the burden has had its rest.

        Raises NoResult when the inlet does not pass the rate.
        """
        time, state = run.simulation.time, run.simulation.particles.state
        if len(state):
            self._watch(run)
        if time >= len(self.accounts) * ACCOUNT_INTERVAL - 0.5 * run.simulation.dt:
            self.accounts.append(self.account(run, len(self.accounts) % LEVEL_EVERY == 0))
            if self.phase == RUN_UP and self._is_steady():
                self.phase, self.steady_from = CHARGE, time
        if run.is_fed and self.phase != REST:
            self.phase, self.fed_at = REST, time
        if self.phase == REST:
            left = self.fed_at + self.test.rest_seconds - time
            if left <= LOAD_LOOKS * CHECK_INTERVAL and len(state):
                self.wear.load(find_loads(state, run.simulation.near_walls))
            if left <= 0.5 * run.simulation.dt:
                self.accounts.append(self.account(run, True))
                return "complete"
        if run.simulation.step >= run.last_step:
            fed = run.accounts[0]
            raise NoResult(
                f"the inlet passed only {fed.born_kg:.0f} kg of {fed.asked_kg:.0f} kg in {time:.0f} s"
            )
        return None

    def account(self, run: CaseRun, with_level: bool) -> Account:
        """Where the mass is now."""
        s = run.simulation
        state = s.particles.state
        place = places_of(state[:, X : Z + 1], state[:, R], self.test.plant)
        mass = np.bincount(place, state[:, M], 4)
        lost = float(mass[LOST]) + float(s.left.all().mass.sum())
        fed = sum(a.born_kg for a in run.accounts)
        level = math.nan
        if with_level:
            inside = place == HOPPER
            surface = scan_surface(state[inside, X : Z + 1], state[inside, R], self.bowl, 0.05)
            level = float(surface.top.mean())
        return Account(s.time, fed, float(mass[BELT]), float(mass[FLIGHT]), float(mass[HOPPER]), lost, level)

    def _is_steady(self) -> bool:
        rows = round(self.test.plant.belt.ride_seconds / ACCOUNT_INTERVAL)
        if len(self.accounts) < 2 * rows:
            return False
        masses = np.array([a.on_belt for a in self.accounts[-2 * rows :]])
        before, now = float(masses[:rows].mean()), float(masses[rows:].mean())
        heaviest = max(g.particle_density * math.pi / 6.0 * g.sizes.largest**3 for g in self.test.grains)
        return abs(now - before) <= max(STEADY * now, heaviest if now > heaviest else 0.0)

    def _watch(self, run: CaseRun) -> None:
        """Section, jet and strikes since the last check."""
        s, belt = run.simulation, self.test.plant.belt
        state = s.particles.state
        interval = run.check_steps * s.dt
        falls = state[state[:, VZ] < -1.0]
        for watched in (self.jet, self.aim):
            watched.add(falls[:, X : Z + 1], falls[:, VX : VZ + 1], 2.0 * falls[:, R], falls[:, M], interval)
        present = walls_at(s.walls, s.step, s.dt)
        self.wear.strike(find_strikes(state, s.walls, present, interval))
        # Never the same grain twice: the window must have run past.
        if self.phase == CHARGE and s.time - self.sampled >= SECTION_LENGTH / belt.speed:
            self.sampled = s.time
            offset = state[:, X : Z + 1] - np.array(belt.tangent_point)
            upstream = -(offset @ np.array(belt.running)) - belt.transition_length - SECTION_GAP
            above = offset @ np.array(belt.normal)
            there = (upstream >= 0.0) & (upstream < SECTION_LENGTH) & (above > 0.0) & (above < SECTION_HEIGHT)
            chosen = state[there]
            self.section.add(offset[there, 1], above[there], 2.0 * chosen[:, R], chosen[:, M])

    def fraction(self, run: CaseRun) -> float:
        """Rough share of the work: a particle costs from when it came, so the square of the fed time."""
        time, fed = run.simulation.time, self.test.charge.duration
        whole = 0.5 * fed + self.test.rest_seconds
        done = 0.5 * min(time, fed) ** 2 / fed + max(time - fed, 0.0)
        return min(1.0, done / whole)

    def numbers(self) -> dict[str, Any]:
        """State to save."""
        return {
            "accounts": [list(a) for a in self.accounts],
            "steady_from": self.steady_from,
            "fed_at": self.fed_at,
            "sampled": self.sampled,
            "section": self.section.numbers(),
            "jet": self.jet.numbers(),
            "aim": self.aim.numbers(),
            "wear": self.wear.numbers(),
        }

    def restore(self, numbers: Mapping[str, Any]) -> None:
        """State from a checkpoint."""
        self.accounts = [Account(*row) for row in numbers["accounts"]]
        for name in ("steady_from", "fed_at", "sampled"):
            setattr(self, name, numbers[name])
        self.section.restore(numbers["section"])
        self.jet.restore(numbers["jet"])
        self.aim.restore(numbers["aim"])
        self.wear.restore(numbers["wear"])

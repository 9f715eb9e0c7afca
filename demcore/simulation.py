"""The simulation loop: search neighbours when needed, advance in compiled chunks, forget who left.

All state is plain arrays; between two chunks a simulation can be saved and loaded again, and goes on with the
same bits (checkpoint.py).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from demcore.case import MaterialTable
from demcore.contact.model import ContactModel
from demcore.errors import BlowUp
from demcore.forces import Neighbours, touching_contacts
from demcore.geometry.motion import next_change, place_walls
from demcore.geometry.wall_rows import Walls
from demcore.integrator import advance_serial, advance_threaded
from demcore.neighbours import empty_neighbours, search
from demcore.particles import VX, VZ, WX, WZ, I, M, Particles, R, X, Z
from demcore.wall_list import WallList, empty_wall_list
from demcore.wall_search import find_crossing, find_inside, find_racing_wall, list_walls, wall_label
from demcore.wrench import OVERLAP, material_tables

GRAVITY = (0.0, 0.0, -9.81)
# Share of the smallest radius: longer lists against rarer searches; flat optimum between .2 and .5.
SKIN = 0.5
# The contact laws mean nothing beyond an overlap of this share of the smaller radius.
LARGEST_OVERLAP = 0.5


@dataclass
class Simulation:
    """A bed of particles between walls. `dt` s; particles below `floor` (z, m) or beyond `reach` (|x|, |y|)
    leave, and are logged in `left`: (number, step) rows at the search that noticed."""

    particles: Particles
    walls: Walls
    model: ContactModel
    table: MaterialTable
    dt: float
    gravity: NDArray[np.float64] = field(default_factory=lambda: np.array(GRAVITY))
    floor: float = -np.inf
    reach: float = np.inf
    threaded: bool = False
    skin: float = 0.0
    step: int = 0
    searches: int = 0
    neighbours: Neighbours = field(default_factory=lambda: empty_neighbours(0))
    near_walls: WallList = field(default_factory=empty_wall_list)
    wall_names: tuple[str, ...] = ()
    stale: bool = True
    left: list[tuple[int, int]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._tables = material_tables(*self.table.arrays())
        if not self.skin:
            self.skin = SKIN * float(self.particles.state[:, R].min())
        if self.neighbours.slab_start[-1] != len(self.particles.number):
            self.neighbours = empty_neighbours(len(self.particles.number))

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return self.step * self.dt

    @property
    def count(self) -> int:
        return len(self.particles.number)

    def advance(self, steps: int) -> None:
        """Make `steps` steps. Raises BlowUp when a number is no longer finite or an overlap is absurd."""
        end = self.step + steps
        advance = advance_threaded if self.threaded else advance_serial
        while self.step < end:
            place_walls(self.walls, self.time, self.dt)
            if self.stale:
                self._search()
            if self.count == 0:
                self.step = end
                place_walls(self.walls, self.time, self.dt)
                break
            # A wall appears or vanishes with a search of its own, at its step however a run is cut up.
            change = next_change(self.walls, self.step, self.dt)
            made, self.stale = advance(
                self.step,
                int(min(end, change)) - self.step,
                self.particles,
                self.neighbours,
                self.walls,
                self.near_walls,
                *self.model,
                self._tables,
                self.gravity,
                self.dt,
                self.skin,
            )
            self.step += int(made)
            self.stale = self.stale or self.step == change
            self._check_crossing()

    def _search(self) -> None:
        state = self.particles.state
        bad = ~np.isfinite(state).all(axis=1)
        if bad.any():
            number = int(self.particles.number[np.flatnonzero(bad)[0]])
            raise BlowUp(f"particle {number} is no longer finite at {self.time:.4f} s")
        keep = (
            (state[:, Z] >= self.floor)
            & (np.abs(state[:, X]) <= self.reach)
            & (np.abs(state[:, X + 1]) <= self.reach)
        )
        self.left += [(int(number), self.step) for number in self.particles.number[~keep]]
        self.particles, self.neighbours, order = search(
            self.particles, self.neighbours, self._tables, self.skin, keep, self.threaded
        )
        self.near_walls = list_walls(
            self.particles.state, self.walls, self.skin, self.step, self.dt, order, self.near_walls
        )
        self._check_walls()
        self.searches += 1
        self.stale = False

    def _check_crossing(self) -> None:
        crossing = find_crossing(self.near_walls, self.particles)
        if crossing is not None:
            wall = wall_label(self.wall_names, crossing.wall)
            raise BlowUp(f"particle {crossing.particle} went through {wall} at {self.time:.6g} s")

    def _check_walls(self) -> None:
        """Raises BlowUp for a wall that appears in a particle, and for one too fast to be met."""
        inside = find_inside(self.near_walls, self.particles, self.walls, self.step, self.dt)
        if inside is not None:
            wall = wall_label(self.wall_names, inside.wall)
            raise BlowUp(f"particle {inside.particle} is where {wall} appears at {self.time:.6g} s")
        smallest = float(self.particles.state[:, R].min(initial=np.inf))
        racing = find_racing_wall(self.walls, smallest, self.dt)
        if racing is not None:
            wall = wall_label(self.wall_names, racing)
            raise BlowUp(f"{wall} moves more than half the smallest radius in one step at {self.time:.6g} s")

    def check_overlaps(self) -> float:
        """Largest overlap over the owner's radius; raises BlowUp above LARGEST_OVERLAP."""
        if self.stale or self.count == 0:
            return 0.0
        owner, partner, history = touching_contacts(self.neighbours)
        radius = self.particles.state[:, R]
        share = history[:, OVERLAP] / np.minimum(radius[owner], radius[partner])
        worst = float(share.max(initial=0.0))
        if worst > LARGEST_OVERLAP:
            k = int(share.argmax())
            number = int(self.particles.number[owner[k]])
            raise BlowUp(
                f"particle {number} overlaps its neighbour by {worst:.0%} of the radius at {self.time:.4f} s"
            )
        return worst

    def remove_wall(self, index: int) -> None:
        """Let a wall vanish now; its number stays taken, so that histories of the others keep their keys."""
        self.walls.window[index, 1] = self.time
        self.stale = True

    @property
    def kinetic_energy(self) -> float:
        """J, of travel and spin."""
        s = self.particles.state
        return float(
            0.5
            * (
                s[:, M] * (s[:, VX : VZ + 1] ** 2).sum(axis=1)
                + s[:, I] * (s[:, WX : WZ + 1] ** 2).sum(axis=1)
            ).sum()
        )

"""The simulation loop: search neighbours when needed, advance in compiled chunks, forget who left.

All state is plain arrays; between two chunks a simulation can be saved and loaded again, and goes on with the
same bits (checkpoint.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from demcore.checkpoint import flat, rebuilt
from demcore.contact.model import ContactModel
from demcore.departures import DepartureLog
from demcore.dormancy import Dormancy
from demcore.dormant import (
    AWAKE,
    DORMANT,
    FALLING,
    Dormant,
    all_awake,
    is_calm,
    next_look,
    nobody_dormant,
    reordered,
    with_awake,
)
from demcore.errors import BlowUp
from demcore.forces import Neighbours
from demcore.geometry.motion import next_change, place_walls
from demcore.geometry.wall_arrays import replace_wall
from demcore.geometry.wall_rows import Walls
from demcore.geometry.walls import Wall
from demcore.integrator import advance_serial, advance_threaded
from demcore.interaction import MaterialTable
from demcore.jit import thread_count
from demcore.neighbours import arrange, carry, empty_neighbours, list_pairs, pays_to_arrange
from demcore.particles import VX, VZ, WX, WZ, I, M, Particles, R, join
from demcore.region import Box
from demcore.soundness import find_overlaps, first_faster, first_lost
from demcore.wall_list import WallList, empty_wall_list
from demcore.wall_search import (
    find_crossing,
    find_inside,
    find_racing_wall,
    forgive_crossings,
    list_walls,
    near_moving_walls,
    wall_label,
)
from demcore.wrench import material_tables

GRAVITY = (0.0, 0.0, -9.81)
# Share of the smallest radius: longer lists against rarer searches; flat optimum between .2 and .5.
SKIN = 0.5
# At this share of the smaller radius its centre has reached the other's surface, and no law means anything. Less
# is no blow-up: where coke falls 3 m, a 20 mm grain between two of 100 mm is squeezed by .55, and recovers.
LARGEST_OVERLAP = 1.0
# One impact in a bed of wide sizes is none either: sinter at scale 4 pours for half a second, and in two of five
# seeds a lump of 146 mm meets a 46 mm grain at 6 m/s and reaches 1.04 for some steps; both go on as if nothing had
# been. A step that is too long shows in hundreds of pairs at once.
PRESSED_SHARE = 1e-3
# Nor for a particle that goes farther than this share of its radius in one step: it would jump over contacts.
LARGEST_WAY = 0.5
# Where particles may be squeezed at all, so many may: a share means nothing among the first that come.
FEW_SQUEEZED = 10

STORED_NUMBERS = ("step", "searches", "searched", "particle_steps", "stale", "next_number", "squeezed")


@dataclass
class Simulation:
    """A bed of particles between walls. `dt` s. Particles outside the `domain`, below `floor` (z, m) or beyond
    `reach` (|x|, |y|) leave, and are logged in `left` by the search that noticed. `skin` (m) 0: of the smallest
    particle there is; say it when smaller ones come later. Particles keep their numbers for life.

    `may_squeeze`: of all particles that ever came, the share that soft contacts may press through a wall (counted
    in `squeezed`), or at a check past a neighbour's surface, before that is a BlowUp."""

    particles: Particles
    walls: Walls
    model: ContactModel
    table: MaterialTable
    dt: float
    gravity: NDArray[np.float64] = field(default_factory=lambda: np.array(GRAVITY))
    floor: float = -np.inf
    reach: float = np.inf
    domain: Box | None = None
    threaded: bool = False
    skin: float = 0.0
    dormancy: Dormancy | None = None
    step: int = 0
    searches: int = 0
    searched: int = 0
    particle_steps: int = 0
    neighbours: Neighbours = field(default_factory=lambda: empty_neighbours(0))
    near_walls: WallList = field(default_factory=empty_wall_list)
    wall_names: tuple[str, ...] = ()
    stale: bool = True
    may_squeeze: float = 0.0
    squeezed: int = 0
    left: DepartureLog = field(default_factory=DepartureLog)

    def __post_init__(self) -> None:
        self._tables = material_tables(*self.table.arrays())
        self.next_number = int(self.particles.number.max(initial=-1)) + 1
        if not self.skin:
            self.skin = SKIN * float(self.particles.state[:, R].min())
        self.dormant = self._everybody_awake()
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
        if self.dormancy is not None and not np.array_equal(self.dormant.gravity, self.gravity):
            self.wake_all()
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
            look = next_look(self.dormant, self.step, self.searched)
            self._make_steps(int(min(end, change, look)) - self.step)
            if self.step == change:
                self.wake_all()
            if self.step == look:
                self.stale = self.stale or pays_to_arrange(
                    self.dormant, self.particles.state, self.neighbours
                )
            self._check_crossing()

    def _make_steps(self, steps: int) -> None:
        """So many, or fewer when the search has to come first."""
        given = (
            self.step,
            steps,
            self.particles,
            self.neighbours,
            self.dormant,
            self.walls,
            self.near_walls,
            *self.model,
            self._tables,
            self.gravity,
            self.dt,
            self.skin,
        )
        if self.threaded:
            made, self.stale = advance_threaded(*given, thread_count())
        else:
            made, self.stale = advance_serial(*given)
        self.step += int(made)
        self.particle_steps += int(made) * self.count

    def add(self, born: Particles) -> None:
        """Particles that come now, at rest in no contact; numbered on from the last one ever."""
        self.particles = join(self.particles, born, self.next_number)
        self.dormant = with_awake(self.dormant, len(born.number))
        self.next_number += len(born.number)
        # They have no partners until the search that comes next, which reads their rows here.
        slabs = self.neighbours.slab_start.copy()
        slabs[-1] = self.count
        self.neighbours = self.neighbours._replace(slab_start=slabs)
        self.stale = True

    def _bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper corner of where particles may be, m."""
        lower = np.array([-self.reach, -self.reach, self.floor])
        upper = np.array([self.reach, self.reach, np.inf])
        if self.domain is not None:
            lower = np.maximum(lower, self.domain.lower)
            upper = np.minimum(upper, self.domain.upper)
        return lower, upper

    def _search(self) -> None:
        self.check_motion()
        keep = self.left.note(self.particles, self.step, *self._bounds())
        carried = carry(self.neighbours)
        # Old particles and the old list go before the new list comes: together they would be the peak of memory.
        self.neighbours = empty_neighbours(0)
        arranged = arrange(self.particles, self.skin, self.dt, keep)
        self.particles = arranged.particles
        # A wall may go half a skin before the next search.
        reach = arranged.reach + 0.5 * self.skin
        self.near_walls = list_walls(
            self.particles.state, reach, self.walls, self.step, self.dt, arranged.order, self.near_walls
        )
        self._check_walls()
        self.dormant = reordered(self.dormant, arranged.order)
        if self.dormancy is not None:
            self._let_fall_dormant()
        self.neighbours = list_pairs(arranged, carried, self.dormant.state, self._tables, self.threaded)
        self.searches += 1
        self.searched = self.step
        self.stale = False

    def _let_fall_dormant(self) -> None:
        """Hold who has been calm for long enough; who is near a wall that moves stays awake."""
        state, mode = self.particles.state, self.dormant.state
        calm = is_calm(self.dormant, state)
        mode[calm & (mode == AWAKE)] = FALLING
        moved = near_moving_walls(self.near_walls, self.walls)
        mode[moved], self.dormant.calm[moved] = AWAKE, 0
        held = mode == FALLING
        # Added up anew in the step after this search, the first in which they are held.
        self.dormant.load[mode != DORMANT] = 0.0
        state[held, VX : VZ + 1] = state[held, WX : WZ + 1] = 0.0

    def wake_all(self) -> None:
        """Nobody is dormant from the next step on, which begins with a search: what has changed may touch all."""
        self.dormant = self._everybody_awake()
        self.stale = True

    def _everybody_awake(self) -> Dormant:
        if self.dormancy is None:
            return nobody_dormant(self.count)
        return all_awake(self.count, self.dormancy, self.gravity, self.dt)

    @property
    def dormant_count(self) -> int:
        """How many particles are held."""
        return int(np.count_nonzero(self.dormant.state))

    def _check_crossing(self) -> None:
        crossing = find_crossing(self.near_walls, self.particles)
        if crossing is None:
            return
        self.squeezed += forgive_crossings(self.near_walls)
        if self.squeezed > self._allowed_squeezes():
            wall = wall_label(self.wall_names, crossing.wall)
            raise BlowUp(f"went through {wall}", crossing.particle, self.time)

    def _allowed_squeezes(self) -> float:
        return max(self.may_squeeze * self.next_number, FEW_SQUEEZED) if self.may_squeeze else 0.0

    def _check_walls(self) -> None:
        """Raises BlowUp for a wall that appears in a particle, and for one too fast to be met."""
        inside = find_inside(self.near_walls, self.particles, self.walls, self.step, self.dt)
        if inside is not None:
            wall = wall_label(self.wall_names, inside.wall)
            raise BlowUp(f"is where {wall} appears", inside.particle, self.time)
        smallest = float(self.particles.state[:, R].min(initial=np.inf))
        racing = find_racing_wall(self.walls, smallest, self.dt)
        if racing is not None:
            wall = wall_label(self.wall_names, racing)
            raise BlowUp(f"{wall} moves more than half the smallest radius in one step", time=self.time)

    def check(self) -> None:
        """Raises BlowUp for a bed that is no longer sound: numbers, motion, overlaps."""
        self.check_motion()
        self.check_overlaps()

    def check_motion(self) -> None:
        """Raises BlowUp for a number that is not finite and for one that moves LARGEST_WAY radii in a step."""
        state = self.particles.state
        lost = first_lost(state)
        if lost >= 0:
            raise BlowUp("is no longer finite", self._name(lost), self.time)
        wild = first_faster(state, self.dt, LARGEST_WAY)
        if wild >= 0:
            speed = float(np.sqrt((state[wild, VX : VZ + 1] ** 2).sum()))
            what = f"moves at {speed:.3g} m/s, more than half its radius in a step,"
            raise BlowUp(what, self._name(wild), self.time)

    def _name(self, row: int) -> int:
        return int(self.particles.number[row])

    def check_overlaps(self) -> float:
        """Largest overlap of listed pairs over the smaller radius.

        Raises BlowUp where it is above LARGEST_OVERLAP for more pairs than PRESSED_SHARE or `may_squeeze` allow.
        """
        state = self.particles.state
        found = find_overlaps(self.neighbours, state, LARGEST_OVERLAP)
        if found.beyond > max(PRESSED_SHARE * len(state), self._allowed_squeezes()):
            what = f"overlaps its neighbour by {found.worst:.0%} of the radius"
            raise BlowUp(what, self._name(found.owner), self.time)
        return found.worst

    def replace_wall(self, index: int, wall: Wall) -> None:
        """Another motion, belt or lifetime for a wall from now on; what touched it keeps its history."""
        replace_wall(self.walls, index, wall, self.time)
        self.wake_all()

    def remove_wall(self, index: int) -> None:
        """Let a wall vanish now; its number stays taken, so that histories of the others keep their keys."""
        self.walls.window[index, 1] = self.time
        self.wake_all()

    @property
    def mass(self) -> float:
        """kg of all particles there."""
        return float(self.particles.state[:, M].sum())

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

    def stored(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Numbers and arrays that a checkpoint keeps; the rest comes from the case."""
        numbers = {name: getattr(self, name) for name in STORED_NUMBERS}
        arrays: dict[str, NDArray[Any]] = {}
        for prefix, record in self._records().items():
            arrays |= flat(prefix, record)
        return numbers, arrays

    def restore(self, numbers: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `stored` kept."""
        for name in STORED_NUMBERS:
            setattr(self, name, numbers[name])
        found = {prefix: rebuilt(prefix, record, arrays) for prefix, record in self._records().items()}
        self.particles, self.neighbours = found["particles"], found["neighbours"]
        self.dormant = found["dormant"]
        self.walls, self.near_walls = found["walls"], found["near_walls"]
        self.left.restore(found["left"])

    def _records(self) -> dict[str, Any]:
        return {
            "particles": self.particles,
            "neighbours": self.neighbours,
            "dormant": self.dormant,
            "walls": self.walls,
            "near_walls": self.near_walls,
            "left": self.left.all(),
        }

"""Feeds under way: when each particle is due at its inlet, who waits for a free place, and what came.

Particle k is due when the mass that was due before it and half of its own have had the time to come:
t_k = start + (M_k + m_k / 2) / rate. So the mass that came never strays from rate (t - start) by more than half
a particle, and nothing is rounded per step (physics.md section 6: 714 came for 700 in one code). Each particle
draws its places from a stream of its own, so a run does not depend on how it is cut up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.charge import Feed
from demcore.geometry.wall_rows import Walls
from demcore.insertion import choose_places, walls_at
from demcore.interaction import GrainRow
from demcore.material import Material
from demcore.particles import Floats, Particles, R, X, Z, spheres
from demcore.sampling import components, draw_mass

# Places that a particle tries each time, and misses in one round after which the inlet counts as blocked.
TRIES = 40
PATIENCE = 8
BLOCK = 16
# Streams of random numbers: sizes, and places.
SIZES, PLACES = 0, 1
LONGEST_INTERVAL = 0.01


class FeedAccount(NamedTuple):
    """What a feed was asked for and what came: kg and particles; waiting: due, but without a free place yet."""

    asked_kg: float
    born_kg: float
    born: int
    waiting_kg: float
    waiting: int


class Feeder:
    """One feed while it runs. Its state is `next` (particles that were due so far) and `waiting`."""

    def __init__(
        self,
        feed: Feed,
        grains: Sequence[Material],
        rows: Sequence[GrainRow],
        until: float,
        seed: Sequence[int],
    ) -> None:
        """`until` is the end of the simulation, s; `seed` names the random streams of this feed."""
        self.feed = feed
        self.seed = [*seed, feed.seed]
        self.asked = min(feed.total, feed.rate * (until - feed.start))
        rng = np.random.default_rng([*self.seed, SIZES])
        self.draw = draw_mass(components(feed.mix, grains, rows), self.asked, rng)
        mass = self.draw.mass
        self.due = feed.start + (np.cumsum(mass) - 0.5 * mass) / feed.rate
        self.next = 0
        self.waiting: NDArray[np.int64] = np.zeros(0, np.int64)

    @property
    def is_done(self) -> bool:
        """Everything has come."""
        return self.next == len(self.due) and len(self.waiting) == 0

    def longest_interval(self, gravity: Floats) -> float:
        """Time between two rounds, s, in which no particle flies farther than its smallest radius.

        So a particle that is born in flight cannot have passed through a wall.
        """
        smallest = float(self.draw.radius.min())
        speed = math.hypot(*self.feed.velocity)
        fall = math.sqrt(float(gravity @ gravity))
        # v t + g t^2 / 2 = r
        flight = 2.0 * smallest / (speed + math.sqrt(speed * speed + 2.0 * fall * smallest) + 1e-300)
        return min(flight, LONGEST_INTERVAL)

    def births(self, step: int, dt: float, bed: Particles, walls: Walls, gravity: Floats) -> Particles | None:
        """Particles that come at this step, None when none does; their numbers are the caller's business.

        A particle that was due since the last round is born where it has flown to; one that waited starts at
        the inlet.
        """
        time = step * dt
        first = self.next
        self.next = int(np.searchsorted(self.due, time, side="right"))
        queue = np.concatenate([self.waiting, np.arange(first, self.next)])
        if len(queue) == 0:
            return None
        flight = np.where(queue >= first, time - self.due[queue], 0.0)[:, None]
        way = np.array(self.feed.velocity) * flight + 0.5 * gravity * flight**2
        place, found = self._find_places(queue, step, way, bed, (walls, walls_at(walls, step, dt)))
        self.waiting = queue[~found]
        if not found.any():
            return None
        born = queue[found]
        return spheres(
            place[found],
            self.draw.radius[born],
            self.draw.density[born],
            self.draw.row[born],
            (np.array(self.feed.velocity) + gravity * flight)[found],
        )

    def _find_places(
        self,
        queue: NDArray[np.int64],
        step: int,
        way: Floats,
        bed: Particles,
        walls: tuple[Walls, NDArray[np.bool_]],
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Places (K, 3), m, and who found one (K,); block by block, because a blocked inlet stops it early.

        `walls` are the rows and which of them are there."""
        position, size = self._bed_nearby(bed, float(np.abs(way).max()), len(queue))
        there = len(size) - len(queue)
        place = np.zeros((len(queue), 3))
        found = np.zeros(len(queue), np.bool_)
        patience = PATIENCE
        for begin in range(0, len(queue), BLOCK):
            block = slice(begin, begin + BLOCK)
            points = np.stack([self._points(int(k), step) for k in queue[block]]) + way[block, None, :]
            radius = self.draw.radius[queue[block]]
            chosen = choose_places(points, radius, position, size, there, *walls, patience)
            free = chosen >= 0
            place[block][free] = points[free, chosen[free]]
            found[block] = free
            there += int(free.sum())
            patience -= int((~free).sum())
            if patience <= 0:
                break
        return place, found

    def _points(self, k: int, step: int) -> Floats:
        uniform = np.random.default_rng([*self.seed, PLACES, k, step]).random((TRIES, 2))
        return self.feed.inlet.points(uniform, float(self.draw.radius[k]))

    def _bed_nearby(self, bed: Particles, way: float, room: int) -> tuple[Floats, Floats]:
        """Spheres that a new one could touch, with `room` free rows at the end."""
        position, radius = bed.state[:, X : Z + 1], bed.state[:, R]
        reach = self.feed.inlet.extent + way + float(self.draw.radius.max())
        close = (np.abs(position - np.array(self.feed.inlet.centre)) < reach + radius[:, None]).all(axis=1)
        return (
            np.concatenate([position[close], np.zeros((room, 3))]),
            np.concatenate([radius[close], np.zeros(room)]),
        )

    def account(self) -> FeedAccount:
        """Mass and particles so far."""
        came = float(self.draw.mass[: self.next].sum())
        waiting = float(self.draw.mass[self.waiting].sum())
        return FeedAccount(
            self.asked, came - waiting, self.next - len(self.waiting), waiting, len(self.waiting)
        )

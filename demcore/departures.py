"""Who left the domain: number, time, place, velocity, mass and side, as arrays that grow by blocks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.particles import VX, VZ, Floats, M, Particles, X, Z

SIDES = ("-x", "+x", "-y", "+y", "-z", "+z")


class Departures(NamedTuple):
    """One row a particle, in order of time: number (K,); step (K,) of the search that noticed; position (K, 3), m,
    and velocity (K, 3), m/s, at that step; mass (K,), kg; material (K,) row; side (K,) index into SIDES.

    A search comes when something has left its halo (neighbours.reaches), so a particle is noticed within its own:
    at most 200 steps late, and that only where nearly all others are slow.
    """

    number: NDArray[np.int64]
    step: NDArray[np.int64]
    position: Floats
    velocity: Floats
    mass: Floats
    material: NDArray[np.int32]
    side: NDArray[np.int8]


NOBODY = Departures(
    np.zeros(0, np.int64),
    np.zeros(0, np.int64),
    np.zeros((0, 3)),
    np.zeros((0, 3)),
    np.zeros(0),
    np.zeros(0, np.int32),
    np.zeros(0, np.int8),
)


class DepartureLog:
    """The departures of a run. Adding costs nothing while nobody leaves; blocks are joined when read."""

    def __init__(self) -> None:
        self._blocks: list[Departures] = [NOBODY]

    def __len__(self) -> int:
        return sum(len(block.number) for block in self._blocks)

    def note(self, particles: Particles, step: int, lower: Floats, upper: Floats) -> NDArray[np.bool_]:
        """Log those outside the box from `lower` to `upper` (3,), m; returns who stays (N,).

        Who is outside several sides left by the one that it is farthest beyond.
        """
        position = particles.state[:, X : Z + 1]
        gone: NDArray[np.bool_] = np.any((position < lower) | (position > upper), axis=1)
        if gone.any():
            x = position[gone]
            beyond = np.stack([lower - x, x - upper], axis=2).reshape(len(x), 6)
            self._blocks.append(
                Departures(
                    particles.number[gone],
                    np.full(len(x), step, np.int64),
                    x.copy(),
                    particles.state[gone, VX : VZ + 1],
                    particles.state[gone, M],
                    particles.material[gone],
                    beyond.argmax(axis=1).astype(np.int8),
                )
            )
        return np.logical_not(gone)

    def all(self) -> Departures:
        """Every departure so far."""
        if len(self._blocks) > 1:
            joined = (np.concatenate(columns) for columns in zip(*self._blocks, strict=True))
            self._blocks = [Departures(*joined)]
        return self._blocks[0]

    def restore(self, departures: Departures) -> None:
        """Take over those of a checkpoint."""
        self._blocks = [departures]

"""Points of the box: the Sobol initial design, candidate sets and seeds; all are pure functions."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from service.domain.search_space import SearchSpace

FloatArray = NDArray[np.float64]
X = tuple[float, ...]

CANDIDATES = 2048
_LOCAL_SPREADS = (0.02, 0.08)
_LOCAL_POINTS = 64
_LARGEST_SEED = 2**31 - 1

# One stream of random numbers per purpose, so that no two purposes share theirs.
STREAM_INITIAL, STREAM_CANDIDATES, STREAM_LOCAL, STREAM_FANTASY, STREAM_SIMULATION = range(5)
STREAM_NORMALS, STREAM_HYPERCUBE, STREAM_ORDER = 5, 6, 7


def generator(*key: int) -> np.random.Generator:
    """A generator that depends on the key alone."""
    return np.random.default_rng(np.random.SeedSequence(key))


def simulation_seed(study_seed: int, number: int, used: Collection[int]) -> int:
    """A seed of design `number` that no other run at the same x has used."""
    stream = generator(STREAM_SIMULATION, study_seed, number)
    while (seed := int(stream.integers(1, _LARGEST_SEED))) in used:
        pass
    return seed


def sobol(dimension: int, count: int, *key: int) -> FloatArray:
    """`count` scrambled Sobol points in the unit cube."""
    sequence = qmc.Sobol(dimension, scramble=True, rng=generator(*key))
    points: FloatArray = sequence.random_base2(max(1, math.ceil(math.log2(count))))
    return points[:count]


def grid_size(space: SearchSpace) -> float:
    """Number of distinct designs on the step grid; infinite when a variable has no step."""
    size = 1.0
    for v in space.variables:
        size *= math.inf if v.step is None else math.floor((v.upper - v.lower) / v.step + 1e-9) + 1
    return size


def whole_grid(space: SearchSpace) -> list[X]:
    """Every design of a grid; only for spaces whose `grid_size` is small."""
    levels = []
    for v in space.variables:
        if v.step is None:
            raise ValueError(f"{v.name} has no step, so its grid is infinite")
        count = math.floor((v.upper - v.lower) / v.step + 1e-9) + 1
        levels.append([v.snap(v.lower + i * v.step) for i in range(count)])
    mesh = np.meshgrid(*levels, indexing="ij")
    return [tuple(map(float, row)) for row in np.column_stack([m.ravel() for m in mesh])]


def snapped(space: SearchSpace, points: FloatArray) -> list[X]:
    """Distinct designs nearest to unit-cube points, in their order."""
    return list(dict.fromkeys(space.from_unit(row) for row in points.tolist()))


def initial_design(space: SearchSpace, seed: int, count: int) -> list[X]:
    """The first `count` distinct Sobol designs of a study; fewer only if the grid itself holds fewer."""
    wanted = int(min(count, grid_size(space)))
    draws = max(64, 4 * wanted)
    while len(found := snapped(space, sobol(space.dimension, draws, STREAM_INITIAL, seed))) < wanted:
        if draws >= 2**16:
            found = list(dict.fromkeys(found + whole_grid(space)))
            break
        draws *= 4
    return found[:wanted]


def candidates(space: SearchSpace, seed: int, number: int) -> list[X]:
    """Designs among which a proposal is chosen: the whole grid if it is small, else fresh Sobol points."""
    if grid_size(space) <= CANDIDATES:
        return whole_grid(space)
    return snapped(space, sobol(space.dimension, CANDIDATES, STREAM_CANDIDATES, seed, number))


def around(space: SearchSpace, x: X, seed: int, number: int) -> list[X]:
    """Designs near x, at two scales, to refine the best candidate."""
    stream = generator(STREAM_LOCAL, seed, number)
    centre = np.asarray(space.to_unit(x))
    steps = [stream.normal(0.0, s, (_LOCAL_POINTS, space.dimension)) for s in _LOCAL_SPREADS]
    return snapped(space, np.clip(centre + np.vstack(steps), 0.0, 1.0))


def to_unit(space: SearchSpace, xs: Collection[X]) -> FloatArray:
    """Unit-cube coordinates of designs, shape (count, d)."""
    return np.array([space.to_unit(x) for x in xs], dtype=np.float64).reshape(len(xs), space.dimension)

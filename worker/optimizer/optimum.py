"""*The* optimum among designs that are as good as each other, and sets of parameters that spread over the rest.

Tie-break (calibration.md decision 8): largest P(window), then cheapest time step, then nearest to literature.
P(window) is the chance that a run ends well and that every response lies in its window (inflated sd, responses
independent given the parameters).

Ensemble: points of the posterior's 95 % region of highest density with P(window) at or above a level, then
farthest point first (Gonzalez 1985) in the unit cube from the optimum: each next one is the point whose nearest
chosen one is farthest away. Parameters that are not identified are thereby spread over all of their range,
which is what a charge's spread is to show; identified ones stay.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from worker.optimizer.acquisition import window_probability
from worker.optimizer.design import FloatArray, X, generator, to_unit
from worker.optimizer.posterior import Beliefs, Sample

# Chances that differ by less are equal: so much the crash classifier's prior differs between a corner and the
# middle of a box where nothing crashed. Of time steps the same share.
TIE = 0.02
# Candidates of the ensemble, drawn by their weights.
POOL = 2000
REGION = 0.95
_STREAM_OPTIMUM, _STREAM_ENSEMBLE = 103, 104
_TRIED = 2000
RULE = "largest P(window), then the longest time step, then the nearest to literature"


class Preferences(NamedTuple):
    """What breaks ties: time step of a design, s (None: all cost the same), and published values by parameter."""

    time_step: Callable[[X], float] | None = None
    literature: Mapping[str, float] | None = None


@dataclass(frozen=True)
class Optimum:
    """The design that the tie-break chose among `tied` with P(window) within .02 of the largest."""

    x: X
    window_probability: float
    time_step_s: float | None
    distance_to_literature: float | None
    tied: int


@dataclass(frozen=True)
class Member:
    """One set of an ensemble; `weight` is its share of the posterior: of the pool, what is nearest to it."""

    x: X
    window_probability: float
    weight: float


@dataclass(frozen=True)
class Ensemble:
    """The optimum first. `level`: the least P(window) of the alternates, lower than asked for where too few
    reach that; `text` says how they were chosen."""

    members: tuple[Member, ...]
    level: float
    text: str


def window_chance(known: Beliefs, u: FloatArray) -> FloatArray:
    """P(window) (k,) at points of the unit cube (k, d)."""
    chance = known.crashes.ok_probability(u)
    for response in known.spec.responses:
        mean, sd = known.emulators[response.observable].predict(u)
        chance = chance * window_probability(mean, sd, response.window)
    return np.asarray(chance)


def optimum(
    known: Beliefs, sample: Sample, tried: Sequence[X] = (), like: Preferences | None = None
) -> Optimum:
    """Among `tried` designs and points drawn from the posterior, all on the study's steps."""
    like, space = like or Preferences(), known.spec.space
    rng = generator(_STREAM_OPTIMUM, known.spec.seed)
    drawn = sample.u[rng.choice(len(sample.u), _TRIED, p=sample.w)]
    designs = list(dict.fromkeys([*tried, *(space.from_unit(row) for row in drawn.tolist())]))
    chance = window_chance(known, to_unit(space, designs))
    best = float(chance.max())
    probability = dict(zip(designs, chance.tolist(), strict=True))
    tied = [x for x in designs if probability[x] >= best - TIE]
    longest = tied
    steps = {x: like.time_step(x) for x in tied} if like.time_step else {}
    if steps:
        longest = [x for x in tied if steps[x] >= (1.0 - TIE) * max(steps.values())]
    away = {x: distance_to_literature(known, x, like.literature) for x in longest}
    chosen = min(longest, key=lambda x: (away[x] or 0.0, -probability[x], x))
    return Optimum(chosen, probability[chosen], steps.get(chosen), away[chosen], len(tied))


def distance_to_literature(known: Beliefs, x: X, literature: Mapping[str, float] | None) -> float | None:
    """Root mean square distance, in widths of the ranges, over the published parameters; None without any."""
    rows = [
        ((value - literature[v.name]) / (v.upper - v.lower)) ** 2
        for value, v in zip(x, known.spec.space.variables, strict=True)
        if literature and v.name in literature
    ]
    return float(np.sqrt(np.mean(rows))) if rows else None


def ensemble(known: Beliefs, sample: Sample, best: Optimum, n: int, level: float = 0.5) -> Ensemble:
    """The optimum and n - 1 alternates; the same study, seed and n give the same sets."""
    space, rng = known.spec.space, generator(_STREAM_ENSEMBLE, known.spec.seed)
    pool, chance = _pool(known, sample, rng)
    reached = level
    if np.count_nonzero(chance >= level) < 10 * n:
        # Too few to spread over: as many of the best as that takes.
        reached = float(np.sort(chance)[::-1][min(10 * n, len(chance)) - 1])
    keep = chance >= min(level, reached)
    points, chance = pool[keep], chance[keep]
    first = np.array([space.to_unit(best.x)])
    chosen = _farthest_first(points, first, n - 1)
    centres = np.vstack([first, points[chosen]])
    nearest = np.argmin(((points[:, None, :] - centres) ** 2).sum(axis=2), axis=1)
    share = np.bincount(nearest, minlength=len(centres)) / len(points)
    xs = [best.x, *(space.from_unit(row) for row in points[chosen].tolist())]
    probabilities = [best.window_probability, *chance[chosen].tolist()]
    members = tuple(Member(x, p, w) for x, p, w in zip(xs, probabilities, share.tolist(), strict=True))
    return Ensemble(members, min(level, reached), _how(level, min(level, reached)))


def _pool(known: Beliefs, sample: Sample, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Distinct designs (k, d) of the region of highest density, on the study's steps, and their P(window) (k,)."""
    drawn = rng.choice(len(sample.u), POOL, p=sample.w)
    heavy = drawn[sample.w[drawn] >= np.quantile(sample.w[drawn], 1.0 - REGION)]
    space = known.spec.space
    designs = list(dict.fromkeys(space.from_unit(row) for row in sample.u[heavy].tolist()))
    points = to_unit(space, designs)
    return points, window_chance(known, points)


def _farthest_first(points: FloatArray, first: FloatArray, count: int) -> list[int]:
    """Indices of up to `count` points, each the farthest from those before and from `first` (1, d)."""
    apart = ((points - first) ** 2).sum(axis=1)
    chosen: list[int] = []
    while len(chosen) < count and float(apart.max(initial=0.0)) > 0.0:
        farthest = int(np.argmax(apart))
        chosen.append(farthest)
        apart = np.minimum(apart, ((points - points[farthest]) ** 2).sum(axis=1))
    return chosen


def _how(asked: float, reached: float) -> str:
    text = (
        f"The optimum, then the farthest points of the posterior's {100 * REGION:.0f} % region "
        f"whose chance to meet every window is at least {reached:.2f}"
    )
    return text + ("." if reached >= asked else f" (too few reach the {asked:.2f} that was asked for).")

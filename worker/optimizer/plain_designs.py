"""Designs of experiments that are fixed before the first run (calibration.md decision 9).

Each is a pure function of the spec. A study goes through its list in order; a design that is in the list twice
runs with two seeds. What was added by hand, or ran under a smaller budget, counts as done where it is in the list.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from pyDOE3 import get_orthogonal_array, list_orthogonal_arrays
from scipy.stats import qmc

from service.domain.search_space import SearchSpace
from service.domain.study import StudySpec
from worker.optimizer.design import (
    STREAM_HYPERCUBE,
    STREAM_ORDER,
    FloatArray,
    X,
    generator,
    initial_design,
    simulation_seed,
)
from worker.optimizer.history import History
from worker.optimizer.outlook import build_outlook
from worker.optimizer.proposal import place_of
from worker.optimizer.proposed import Proposal
from worker.optimizer.stopping import Stop, design_complete, too_many_failures

REASONS: Mapping[str, str] = {
    "sobol": "Sobol point",
    "latin_hypercube": "Point of the Latin hypercube",
    "factorial": "Combination of the full factorial",
    "taguchi": "Row of the orthogonal array",
    "table": "Row of the table",
}


def plan(spec: StudySpec) -> list[X]:
    """All designs of the study, in their order."""
    return _PLANS[spec.strategy](spec)


def next_planned(spec: StudySpec, history: History, number: int) -> Proposal | Stop:
    """The first design of the plan that has not run, or the end."""
    if (stop := too_many_failures(history)) is not None:
        return stop
    left = Counter([d.x for d in history.finished if d.origin != "import"] + [p.x for p in history.pending])
    listed = plan(spec)
    for k, x in enumerate(listed if place_of(spec, history, number).left >= 1 else [], start=1):
        if left[x]:
            left[x] -= 1
            continue
        seed = simulation_seed(spec.seed, number, history.seeds_used(x))
        reason = f"{REASONS[spec.strategy]} {k} of {len(listed)}."
        return Proposal(x, seed, "doe", None, None, reason, history.training_hash, None, spec.scale)
    return design_complete(build_outlook(spec, history) if history.succeeded else None, spec, history)


def _sobol(spec: StudySpec) -> list[X]:
    return initial_design(spec.space, spec.seed, spec.budget)


def _latin_hypercube(spec: StudySpec) -> list[X]:
    """Optimised by exchanging coordinates for a small centred discrepancy (scipy's "random-cd")."""
    stream = generator(STREAM_HYPERCUBE, spec.seed)
    sampler = qmc.LatinHypercube(spec.space.dimension, optimization="random-cd", rng=stream)
    return [spec.space.from_unit(row) for row in sampler.random(spec.budget).tolist()]


def _factorial(spec: StudySpec) -> list[X]:
    """As many even levels as the budget pays for: one more for each variable in turn."""
    counts = [2] * spec.space.dimension
    most = [_levels_at_most(spec.space, j) for j in range(spec.space.dimension)]
    counts = [min(a, b) for a, b in zip(counts, most, strict=True)]
    grown = True
    while grown:
        grown = False
        for j in range(len(counts)):
            larger = math.prod(counts) // counts[j] * (counts[j] + 1)
            if counts[j] < most[j] and larger <= spec.budget:
                counts[j], grown = counts[j] + 1, True
    levels = [np.linspace(0.0, 1.0, count) for count in counts]
    return _shuffled(spec, itertools.product(*levels))


def _levels_at_most(space: SearchSpace, j: int) -> int:
    variable = space.variables[j]
    if variable.step is None:
        return 1000
    return math.floor((variable.upper - variable.lower) / variable.step + 1e-9) + 1


def _taguchi(spec: StudySpec) -> list[X]:
    """The largest standard array that the budget pays for; of equal ones that with more levels."""
    array = orthogonal_array(spec.space.dimension, spec.budget)
    highest = np.maximum(array.max(axis=0), 1)
    return _shuffled(spec, (array / highest).tolist())


def _shuffled(spec: StudySpec, rows: Iterable[Sequence[float]]) -> list[X]:
    """In random order: the standard order begins in one corner, and where that corner crashes it looks as if the
    whole box did."""
    designs = [spec.space.from_unit(u) for u in rows]
    return [designs[i] for i in generator(STREAM_ORDER, spec.seed).permutation(len(designs))]


def orthogonal_array(factors: int, budget: int) -> FloatArray:
    """Levels 0, 1, ... (runs, factors): the last columns of the array, which have the more levels."""
    arrays = [np.asarray(get_orthogonal_array(name), dtype=np.float64) for name in list_orthogonal_arrays()]
    fitting = [a for a in arrays if len(a) <= budget and a.shape[1] >= factors]
    best = max(fitting, key=lambda a: (len(a), a[:, -1].max()))
    return best[:, best.shape[1] - factors :]


def _table(spec: StudySpec) -> list[X]:
    return [tuple(row.x[name] for name in spec.space.names) for row in spec.table if row.results is None]


_PLANS: Mapping[str, Callable[[StudySpec], list[X]]] = {
    "sobol": _sobol,
    "latin_hypercube": _latin_hypercube,
    "factorial": _factorial,
    "taguchi": _taguchi,
    "table": _table,
}

"""What is believed of any design, given a study's history: surrogate, classifier and objective joined.

Notation: see surrogate.py (m, s), crashes.py (P(ok)), acquisition.py (E|f - t|, windows).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from service.domain.study import StudySpec
from worker.optimizer.acquisition import (
    expected_improvement,
    expected_miss,
    seeds_for_certificate,
    window_probability,
)
from worker.optimizer.crashes import CrashClassifier
from worker.optimizer.design import FloatArray, X, to_unit
from worker.optimizer.history import Group, History
from worker.optimizer.surrogate import Hyperparameters, Surrogate, fit_hyperparameters, training_set

# Beyond this a still larger power would only make the search shy of every untried corner.
MOST_SEEDS = 8


class Belief(NamedTuple):
    """Arrays over designs. `mean` and `sd` are the surrogate's; `wide` is the sd after inflation."""

    mean: FloatArray
    sd: FloatArray
    wide: FloatArray
    ok: FloatArray


@dataclass(frozen=True)
class Outlook:
    """Built from finished designs alone; pending ones enter by `with_fantasies` (proposal.py)."""

    spec: StudySpec
    surrogate: Surrogate
    crashes: CrashClassifier
    inflation: float
    groups: tuple[Group, ...]

    def believe(self, xs: Collection[X]) -> Belief:
        u = to_unit(self.spec.space, xs)
        mean, sd = self.surrogate.predict(u)
        return Belief(mean, sd, self.inflation * sd, self.crashes.ok_probability(u))

    def miss(self, belief: Belief) -> FloatArray:
        """E|f - target| with the inflated sd."""
        return expected_miss(belief.mean, belief.wide, self.spec.primary.target)

    def in_window(self, belief: Belief) -> FloatArray:
        return window_probability(belief.mean, belief.wide, self.spec.primary.window)

    def near_target(self, belief: Belief) -> FloatArray:
        """P(|f - target| <= tolerance)."""
        t, tol = self.spec.primary.target, self.spec.primary.tolerance
        return window_probability(belief.mean, belief.wide, (t - tol, t + tol))

    def gain(self, belief: Belief) -> FloatArray:
        """The acquisition: EI of |f - target| times P(all seeds of a winner run); the sd is not inflated.

        The incumbent is the smallest posterior E|f - target| of the evaluated designs, never a lucky angle.
        """
        target = self.spec.primary.target
        seen = self.believe([g.x for g in self.evaluated()])
        incumbent = float(np.min(expected_miss(seen.mean, seen.sd, target)))
        return expected_improvement(belief.mean, belief.sd, target, incumbent) * self.usable(belief)

    def usable(self, belief: Belief) -> FloatArray:
        """P(ok) to the power of the seeds a certificate will take: a winner has to run with each of them."""
        seeds = seeds_for_certificate(self.surrogate.hyper.noise_sd_deg, self.spec.primary)
        return np.asarray(belief.ok ** max(self.spec.replicates, min(seeds, MOST_SEEDS)))

    def evaluated(self) -> tuple[Group, ...]:
        """The groups with at least one run that gave results."""
        return tuple(g for g in self.groups if g.runs)


def build_outlook(spec: StudySpec, history: History, hyper: Hyperparameters | None = None) -> Outlook:
    """Fit the surrogate and the classifier; needs one measured angle. `hyper` repeats an earlier fit."""
    groups = history.groups()
    space, observable = spec.space, spec.primary.observable
    data = training_set((space.to_unit(g.x), angle) for g in groups for angle in g.values(observable))
    hyper = hyper or fit_hyperparameters(data, history.noise_sd_deg())
    surrogate = Surrogate(data, hyper)
    u = to_unit(space, [d.x for d in history.finished])
    ran = np.array([d.results is not None for d in history.finished], dtype=np.float64)
    return Outlook(spec, surrogate, CrashClassifier(u, ran), surrogate.inflation, groups)

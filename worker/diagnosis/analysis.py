"""From measured cells to a ranking of causes; the null runs pass through the same lines as the data do.

calibrate -> linearise -> whiten and project -> rank
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from service.domain.effects import Library
from worker.diagnosis.calibration import Linearised, linearise
from worker.diagnosis.fingerprints import Fingerprints
from worker.diagnosis.model import Model
from worker.diagnosis.ranking import Evidence, Ranking
from worker.diagnosis.simulator import FloatArray
from worker.diagnosis.unexplained import Block, blocks_of

_MOST_AVERAGED = 5


class Statistics(NamedTuple):
    """What is compared with the null runs: evidence of the library, of the unexplained family, and the misfit."""

    library: float
    unexplained: float
    misfit: float


@dataclass(frozen=True)
class Setup:
    """What stays the same for the data and every null run: model, fingerprints, the floor's covariance (N, N), and
    whether scatter is pooled over conditions."""

    model: Model
    known: Library
    prints: Fingerprints
    floor: FloatArray
    pooled: bool = True

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """Of the unexplained family."""
        return blocks_of(self.model.frame)


@dataclass(frozen=True)
class Analysis:
    """`problem` at the re-calibrated parameters, and what was found there."""

    problem: Linearised
    evidence: Evidence

    @cached_property
    def ranking(self) -> Ranking:
        return self.evidence.rank()

    @property
    def statistics(self) -> Statistics:
        return Statistics(*self.evidence.screening, self.problem.misfit)


def analyse(setup: Setup, y: FloatArray, S: FloatArray, theta: FloatArray) -> Analysis:
    """Of means y (N,) with covariance S (N, N), re-calibrated to `theta` (D,)."""
    problem = linearise(setup.model, y, S + setup.floor, theta)
    C, d = setup.model.run_covariance, np.sqrt(np.diag(S))
    return Analysis(problem, Evidence(problem, setup.known, setup.prints, C, setup.blocks, d))


def expected_theta(found: Analysis) -> FloatArray:
    """The parameters (D,) averaged over the models: with an effect in the model, they move back."""
    ranking, problem = found.ranking, found.problem
    inclusion = ranking.inclusion
    weights = inclusion / max(float(np.sum(inclusion)), 1.0)
    theta = problem.theta.copy()
    for k in np.argsort(-inclusion)[:_MOST_AVERAGED]:
        change = ranking.amplitude[k] * ranking.directions.f[ranking.best[k]]
        theta += weights[k] * (problem.shifted(change) - problem.theta)
    return np.clip(theta, 0.0, 1.0)

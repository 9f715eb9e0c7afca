"""Which measurement tells most of the causes per cost (rule 11).

Notation (M models: none, and each single effect, with posterior p; a condition's n cells)
    mu_m    what model m expects of a repeat's means beyond the baseline                 (M, n)
    C       covariance of a repeat's means: noise, emulator, re-calibration's posterior  (n, n)
    I       expected information, nats: entropy of p less its expectation after the measurement

A direct check answers for one effect: it tells whether the amplitude is 0, rightly in `_RELIABLE` of cases. A
repeat of a condition answers for all of them a little; its I is an average over draws.
"""

from __future__ import annotations

import numpy as np

from worker.diagnosis.analysis import Analysis
from worker.diagnosis.measured import Measured
from worker.diagnosis.ranking import Ranking
from worker.diagnosis.result import Proposal
from worker.diagnosis.simulator import FloatArray

MOST_PROPOSALS = 5
_RELIABLE = 0.95
_DRAWS = 200
_LEAST = 1e-3
# A repeat of a pile test costs 1, of a charge more: a bunker has to be filled.
COST_OF = {"pile": 1.0, "charge": 5.0}


def next_measurements(found: Analysis, measured: Measured, seed: int = 1) -> tuple[Proposal, ...]:
    """Checks and repeats with the most expected information for their cost, the best first."""
    proposals = [*_checks(found.ranking, measured), *_repeats(found, measured, seed)]
    worth = [p for p in proposals if p.information > _LEAST]
    return tuple(sorted(worth, key=lambda p: -p.information / p.cost)[:MOST_PROPOSALS])


def _checks(ranking: Ranking, measured: Measured) -> list[Proposal]:
    """One for each effect that acts on a condition that was measured: no tachometer on a belt explains a pile."""
    inclusion = ranking.inclusion
    found = []
    for effect, p in zip(ranking.known.effects, inclusion, strict=True):
        if not any(effect.acts_on(c) for c in measured.frame.conditions):
            continue
        told = _RELIABLE * p + (1.0 - _RELIABLE) * (1.0 - p)
        information = _binary(told) - _binary(_RELIABLE)
        found.append(
            Proposal(effect.check.what, f"check:{effect.id}", max(information, 0.0), effect.check.cost)
        )
    return found


def _binary(p: float) -> float:
    p = min(max(p, 1e-12), 1.0 - 1e-12)
    return float(-p * np.log(p) - (1.0 - p) * np.log(1.0 - p))


def _repeats(found: Analysis, measured: Measured, seed: int) -> list[Proposal]:
    ranking, problem = found.ranking, found.problem
    none, inside, _ = ranking.probabilities
    singles, _ = ranking.model_shares
    p = np.concatenate([[none], inside * singles])
    p = p / np.sum(p)
    shifts = ranking.amplitude[:, None] * ranking.directions.f[ranking.best]
    mu = np.vstack([np.zeros(len(problem.r)), shifts])
    # Re-calibration follows each model: only what it leaves can tell models apart.
    posterior = problem.posterior
    absorbed = problem.J @ posterior @ problem.J.T @ np.linalg.solve(problem.W, mu.T)
    mu = mu - absorbed.T
    C = problem.W + problem.J @ posterior @ problem.J.T
    condition = np.array(measured.frame.condition)
    proposals = []
    for c, here in enumerate(measured.frame.conditions):
        cells = np.flatnonzero(condition == c)
        if len(cells):
            stream = np.random.default_rng(np.random.SeedSequence([seed, 10, c]))
            information = _information(p, mu[:, cells], C[np.ix_(cells, cells)], stream)
            what = f"repeat {here.condition} with as many replicates"
            proposals.append(Proposal(what, f"repeat:{here.condition}", information, COST_OF[here.test]))
    return proposals


def _information(p: FloatArray, mu: FloatArray, C: FloatArray, stream: np.random.Generator) -> float:
    """Expected fall of the entropy of p (M,) by a draw from one of N(mu_m, C)."""
    L = np.linalg.cholesky(C)
    white = np.linalg.solve(L, mu.T).T
    chosen = stream.choice(len(p), _DRAWS, p=p)
    drawn = white[chosen] + stream.standard_normal((_DRAWS, white.shape[1]))
    logs = np.log(np.maximum(p, 1e-300)) - 0.5 * np.sum((drawn[:, None, :] - white[None, :, :]) ** 2, axis=2)
    after = np.exp(logs - np.logaddexp.reduce(logs, axis=1)[:, None])
    return max(_entropy(p) - float(np.mean([_entropy(row) for row in after])), 0.0)


def _entropy(p: FloatArray) -> float:
    return float(-np.sum(p * np.log(np.maximum(p, 1e-300))))

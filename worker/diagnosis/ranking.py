"""Which models explain what is left: none, one effect, two, or none of the library (rules 6 and 7).

Notation (E effects, K directions, U blocks of the unexplained family)
    prior   none 1/2; of the rest singles .60 / E each, pairs .15 / (E(E-1)/2) each, unexplained .25, kinds alike
    incl_k  posterior probability of all models with effect k                       (E,)

Named by marginal inclusion, not by the best model: pairs with k count for k.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import nnls

from service.domain.effects import AZIMUTHS, Library
from worker.diagnosis import unexplained
from worker.diagnosis.calibration import Linearised
from worker.diagnosis.evidence import (
    Whitened,
    amplitude_single,
    form_variance,
    log_bayes_pairs,
    log_bayes_single,
    whiten,
)
from worker.diagnosis.fingerprints import Fingerprints
from worker.diagnosis.simulator import FloatArray
from worker.diagnosis.unexplained import Block

NULL, SINGLES, PAIRS, UNEXPLAINED = 0.5, 0.30, 0.075, 0.125
# How far below the best model one may lie and still be worth its own covariance, nats; and how many at most.
_WORTH = 7.0
_MOST_SINGLES, _MOST_PAIRS = 6, 6
# An amplitude that may be so many times its fitted one is no longer known: its fingerprint is projected out.
_PROJECTED = 10.0


def _log_sum(logs: FloatArray | list[float]) -> float:
    """ln of the sum of exponentials; scipy's takes 100 times as long on so few."""
    return float(np.logaddexp.reduce(logs))


def kind_shares(blocks: tuple[Block, ...]) -> FloatArray:
    """Prior of each block within the family (U,): kinds alike, blocks of a kind alike."""
    kinds = [block.kind for block in blocks]
    return np.array([1.0 / (len(set(kinds)) * kinds.count(kind)) for kind in kinds])


class Directions(NamedTuple):
    """Fingerprints f (K, N) of one-signed amplitudes: which effect (K,), its part along each key, and tau (K,)."""

    f: FloatArray
    effect: NDArray[np.intp]
    along: tuple[Mapping[str, float], ...]
    tau: FloatArray


def directions_of(known: Library, prints: Fingerprints) -> Directions:
    """One for each sign or azimuth of each effect."""
    rows: list[FloatArray] = []
    owner: list[int] = []
    along: list[Mapping[str, float]] = []
    tau: list[float] = []
    for k, effect in enumerate(known.effects):
        if effect.directions_deg:
            first, second = (prints.f[prints.row(key)] for key in effect.keys)
            turns = 2.0 * math.pi * np.arange(AZIMUTHS) / AZIMUTHS
            parts = [(math.cos(t), math.sin(t)) for t in turns]
            rows += [c * first + s * second for c, s in parts]
            along += [dict(zip(effect.keys, part, strict=True)) for part in parts]
        else:
            signs = (1.0, -1.0) if effect.is_two_sided else (1.0,)
            rows += [sign * prints.f[prints.row(effect.id)] for sign in signs]
            along += [{effect.id: sign} for sign in signs]
        owner += [k] * (len(rows) - len(owner))
        tau += [effect.scale] * (len(rows) - len(tau))
    return Directions(np.array(rows), np.array(owner), tuple(along), np.array(tau))


@dataclass(frozen=True)
class Ranking:
    """Log Bayes factors against none: `singles` (E,), `pairs` (E, E) upper triangle, `blocks` (U,).

    `best` (E,) is each effect's best direction, `amplitude` (E,) its fit there, alone.
    """

    known: Library
    blocks: tuple[Block, ...]
    singles: FloatArray
    pairs: FloatArray
    unexplained: FloatArray
    directions: Directions
    best: NDArray[np.intp]
    amplitude: FloatArray

    @property
    def _log_weights(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        count = len(self.known.effects)
        upper = np.triu_indices(count, 1)
        each_pair = math.log(PAIRS / max(len(upper[0]), 1))
        return (
            self.singles + math.log(SINGLES / count),
            self.pairs[upper] + each_pair,
            self.unexplained + np.log(UNEXPLAINED * kind_shares(self.blocks)),
        )

    @property
    def library_evidence(self) -> float:
        """ln of the library's weight over that of no effect."""
        singles, pairs, _ = self._log_weights
        return float(_log_sum(np.concatenate([singles, pairs]))) - math.log(NULL)

    @property
    def unexplained_evidence(self) -> float:
        """ln of the unexplained family's weight over that of no effect."""
        return float(_log_sum(self._log_weights[2])) - math.log(NULL)

    @property
    def probabilities(self) -> tuple[float, float, float]:
        """Of no effect, of the library, of the unexplained family."""
        logs = np.array([0.0, self.library_evidence, self.unexplained_evidence])
        none, inside, outside = np.exp(logs - _log_sum(logs)).tolist()
        return none, inside, outside

    @property
    def inclusion(self) -> FloatArray:
        """(E,)."""
        count = len(self.known.effects)
        total = _log_sum([0.0, self.library_evidence, self.unexplained_evidence]) + math.log(NULL)
        singles, pairs, _ = self._log_weights
        found = np.exp(singles - total)
        for a, b, weight in zip(*np.triu_indices(count, 1), np.exp(pairs - total), strict=True):
            found[a] += weight
            found[b] += weight
        return np.asarray(np.minimum(found, 1.0))

    @property
    def class_inclusion(self) -> dict[str, float]:
        """Posterior probability of all models with an effect of each class."""
        singles, pairs = self.model_shares
        inside = self.probabilities[1]
        classes = np.array([effect.effect_class for effect in self.known.effects])
        found = {}
        for name in dict.fromkeys(classes.tolist()):
            member = classes == name
            of_pairs = float(np.sum(pairs[member[:, None] | member[None, :]]))
            found[name] = min(inside * (float(np.sum(singles[member])) + of_pairs), 1.0)
        return found

    @property
    def model_shares(self) -> tuple[FloatArray, FloatArray]:
        """Posterior of the single effects (E,) and of the pairs (E, E; upper triangle), given the library."""
        singles, pairs, _ = self._log_weights
        total = self.library_evidence + math.log(NULL)
        table = np.zeros_like(self.pairs)
        table[np.triu_indices(len(singles), 1)] = np.exp(pairs - total)
        return np.exp(singles - total), table

    @property
    def block_probabilities(self) -> FloatArray:
        """Of each block, given that the unexplained family holds (U,)."""
        logs = self._log_weights[2]
        return np.asarray(np.exp(logs - _log_sum(logs)))

    @property
    def best_pair(self) -> tuple[int, int]:
        a, b = np.unravel_index(
            np.argmax(np.triu(self.pairs, 1) - 1e9 * np.tri(len(self.pairs))), self.pairs.shape
        )
        return int(a), int(b)


class Fitted(NamedTuple):
    """Directions `rows` fitted beside each other: mode (k,), 0 or more, and the covariance (k, k) that it has
    without that bound. Parameters and the fingerprints' form error are in it."""

    rows: tuple[int, ...]
    mode: FloatArray
    covariance: FloatArray


class Evidence:
    """Residual, fingerprints and covariances of one linearised problem; ranks at any scale of the priors."""

    def __init__(
        self,
        problem: Linearised,
        known: Library,
        prints: Fingerprints,
        C: FloatArray,
        blocks: tuple[Block, ...],
        d: FloatArray,
    ) -> None:
        self.problem, self.known, self.prints, self.blocks, self._d = problem, known, prints, blocks, d
        self._run_variance = np.diag(C)
        self._diagonal = np.diag_indices(len(C))
        self.directions = directions_of(known, prints)
        self.white: Whitened = whiten(problem.r, problem.V)
        self.F = self.white.of(self.directions.f)
        self._q = self.F @ self.white.r
        self._S = self.F @ self.F.T
        self._blocks = unexplained.log_bayes(blocks, d, self.white)

    @property
    def screening(self) -> tuple[float, float]:
        """ln of the average Bayes factor of single effects, and of the unexplained blocks: cheap."""
        d = self.directions
        each = log_bayes_single(self._q, np.diag(self._S), d.tau)
        count = np.bincount(d.effect)[d.effect]
        singles = _log_sum(each - np.log(count)) - math.log(len(self.known.effects))
        return singles, _log_sum(self._blocks + np.log(kind_shares(self.blocks)))

    def rank(self, tau_factor: float = 1.0) -> Ranking:
        """With every prior scale multiplied by `tau_factor`."""
        d = self.directions
        tau = d.tau * tau_factor
        s = np.diag(self._S)
        by_direction = log_bayes_single(self._q, s, tau)
        pair_table = log_bayes_pairs(self._q, self._S, tau)
        count = len(self.known.effects)
        members = np.array([d.effect == k for k in range(count)])
        best = np.array([np.flatnonzero(own)[np.argmax(by_direction[own])] for own in members])
        singles = np.array([_log_sum(by_direction[own]) - math.log(own.sum()) for own in members])
        share = members / members.sum(axis=1, keepdims=True)
        top = np.max(pair_table.log_bayes)
        with np.errstate(divide="ignore"):
            pairs = np.log(share @ np.exp(pair_table.log_bayes - top) @ share.T) + top
        amplitude = amplitude_single(self._q, s, tau)[best]
        corrected = np.zeros(count)
        for k in _worth(singles, _MOST_SINGLES):
            corrected[k] = self._formed((int(best[k]),), tau) - by_direction[best[k]]
        pairs = self._formed_pairs(pairs, pair_table.log_bayes, members, corrected, tau)
        return Ranking(
            self.known,
            self.blocks,
            singles + corrected,
            pairs,
            self._blocks,
            d,
            best,
            amplitude,
        )

    def _formed_pairs(
        self,
        pairs: FloatArray,
        table: FloatArray,
        members: NDArray[np.bool_],
        corrected: FloatArray,
        tau: FloatArray,
    ) -> FloatArray:
        """The best pairs under their own covariances; the others shifted as their stronger member is."""
        count = len(pairs)
        strength = self._q[self._best_of(members)] ** 2
        a, b = np.triu_indices(count, 1)
        stronger = np.where(strength[a] >= strength[b], a, b)
        shifted = np.full((count, count), -np.inf)
        shifted[a, b] = pairs[a, b] + corrected[stronger]
        order = np.argsort(-pairs[a, b])[:_MOST_PAIRS]
        for i, j in zip(a[order], b[order], strict=True):
            rows, columns = np.flatnonzero(members[i]), np.flatnonzero(members[j])
            part = table[np.ix_(rows, columns)]
            if np.isfinite(part).any():
                x, y = np.unravel_index(np.argmax(part), part.shape)
                shifted[i, j] = pairs[i, j] + self._formed((rows[x], columns[y]), tau) - part[x, y]
        return shifted

    def together(self, effects: Sequence[int]) -> Fitted:
        """Effects (indices) as they act beside each other: each along the sign or azimuth that fits best with
        those of the others. Fitted alone, one takes over what belongs to another."""
        choices = [np.flatnonzero(self.directions.effect == k).tolist() for k in effects]
        return self.fitted(max(itertools.product(*choices), key=self._merit))

    def fitted(self, rows: Sequence[int]) -> Fitted:
        """Of these directions."""
        if not rows:
            return Fitted((), np.zeros(0), np.zeros((0, 0)))
        chosen = np.array(rows, dtype=np.intp)
        tau = self.directions.tau
        _, q, S = self._uncertain(tuple(rows), tau)
        precision = S + np.diag(tau[chosen] ** -2.0)
        return Fitted(
            tuple(int(row) for row in rows),
            _mode(q, precision),
            np.asarray(np.linalg.inv(precision), dtype=np.float64),
        )

    def left_over(self, effects: Sequence[int]) -> tuple[float, FloatArray]:
        """After these effects are projected out: ln of the average Bayes factor of the unexplained blocks over
        nothing else, and that of each block (U,)."""
        V = self.problem.V.copy()
        found = self.together(effects)
        sizes = np.maximum(found.mode, np.sqrt(np.diag(found.covariance)))
        for row, a in zip(found.rows, sizes.tolist(), strict=True):
            f = self.directions.f[row]
            V[self._diagonal] += form_variance(f, a, self._seed_noise(row))
            V += (_PROJECTED * a) ** 2 * np.outer(f, f)
        blocks = unexplained.log_bayes(self.blocks, self._d, whiten(self.problem.r, V))
        return _log_sum(blocks + np.log(kind_shares(self.blocks))), blocks

    def _merit(self, rows: Sequence[int]) -> float:
        """ln posterior density at the mode of these directions, up to a constant."""
        chosen = np.array(rows, dtype=np.intp)
        precision = self._S[np.ix_(chosen, chosen)] + np.diag(self.directions.tau[chosen] ** -2.0)
        a = _mode(self._q[chosen], precision)
        return float(self._q[chosen] @ a - 0.5 * a @ precision @ a)

    def _best_of(self, members: NDArray[np.bool_]) -> NDArray[np.intp]:
        signal = self._q / np.sqrt(np.maximum(np.diag(self._S), 1e-300))
        return np.array([np.flatnonzero(own)[np.argmax(signal[own])] for own in members])

    def _formed(self, rows: tuple[int, ...], tau: FloatArray) -> float:
        """ln evidence over none of one or two directions, fingerprints uncertain at their fitted amplitudes."""
        scale = tau[np.array(rows)]
        white, q, S = self._uncertain(rows, tau)
        gained = white.log_density - self.white.log_density
        if len(rows) == 1:
            return gained + float(log_bayes_single(q, np.diag(S), scale)[0])
        return gained + float(log_bayes_pairs(q, S, scale).log_bayes[0, 1])

    def _uncertain(self, rows: tuple[int, ...], tau: FloatArray) -> tuple[Whitened, FloatArray, FloatArray]:
        """The residual whitened under V with the form errors of these directions at their fitted amplitudes, and
        q (k,) and S (k, k) there."""
        chosen = np.array(rows, dtype=np.intp)
        f, scale = self.directions.f[chosen], tau[chosen]
        q, S = self._q[chosen], self._S[np.ix_(chosen, chosen)]
        white = self.white
        for _ in range(2):
            amplitudes = np.maximum(np.linalg.solve(S + np.diag(scale**-2.0), q), 0.0)
            V = self.problem.V.copy()
            for k, a in enumerate(amplitudes):
                V[self._diagonal] += form_variance(f[k], a, self._seed_noise(rows[k]))
            white = whiten(self.problem.r, V)
            F = white.of(f)
            q, S = F @ white.r, F @ F.T
        return white, q, S

    def _seed_noise(self, direction: int) -> FloatArray:
        """Diagonal of w C of a direction (N,), in its scope; parts along two keys add as their squares."""
        keys = self.directions.along[direction]
        weight = sum(part**2 * self.prints.weight[self.prints.row(key)] for key, part in keys.items())
        active = self.prints.active[self.prints.row(next(iter(keys)))]
        return np.asarray(weight * np.where(active, self._run_variance, 0.0))


def _mode(q: FloatArray, precision: FloatArray) -> FloatArray:
    """Amplitudes a (k,) of 0 or more with the largest q'a - a' P a / 2."""
    # scipy 1.17's nnls ends the process where there is nothing to fit.
    if not len(q):
        return np.zeros(0)
    L = np.linalg.cholesky(precision)
    return np.asarray(nnls(L.T, solve_triangular(L, q, lower=True))[0])


def _worth(merit: FloatArray, most: int) -> list[int]:
    order = np.argsort(-merit)
    return [int(k) for k in order[:most] if merit[k] > merit[order[0]] - _WORTH]

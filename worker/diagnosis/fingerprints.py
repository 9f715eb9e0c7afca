"""Fingerprints: what a unit of each effect changes in the cells, from runs, in two stages (rule 5).

Notation (K effect keys, N cells, n seeds)
    f       (mean with effect - mean without) / amplitude, at fixed parameters        (K, N), unit of the cell
    v       its sampling variance: C (1/n + 1/n0) / amplitude^2, C of one run          (K, N) on the diagonal
    t       f / sqrt(v); a cell counts with f max(0, 1 - 2/t^2)

Screening takes few seeds at twice the prior's scale; cells out of scope are zero without a run. The few best are
refined at their fitted amplitude with more seeds, at the parameters that go with them. An amplitude that leaves no
pile, as a cylinder beyond the base's edge does, is halved.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from service.domain.effects import Effect, Library
from worker.diagnosis.measured import Frame, NDArrayBool
from worker.diagnosis.model import Model, physical
from worker.diagnosis.simulator import FloatArray, Setting, Simulator
from worker.diagnosis.summaries import summarise

SCREENING_SEEDS = 8
BASELINE_SEEDS = 24
REFINED_SEEDS = 24
MOST_REFINED = 5
_SCREENED_AT = 2.0
# An eighth of the prior's or the fitted scale: below, a change drowns in the scatter of the runs.
_HALVINGS = 3


@dataclass(frozen=True)
class Fingerprints:
    """f (K, N) by key, and the weight (K,) of C in their covariance: (1/n + 1/n0) / amplitude^2.

    `active` (K, N): the cells in scope, which alone carry noise.
    """

    keys: tuple[str, ...]
    f: FloatArray
    weight: FloatArray
    active: NDArrayBool

    def row(self, key: str) -> int:
        return self.keys.index(key)

    def replaced(self, key: str, f: FloatArray, weight: float) -> Fingerprints:
        """With one fingerprint refined."""
        k = self.row(key)
        F, w = self.f.copy(), self.weight.copy()
        F[k], w[k] = f, weight
        return Fingerprints(self.keys, F, w, self.active)


def shrink(f: FloatArray, variance: FloatArray) -> FloatArray:
    """f max(0, 1 - 2/t^2), cell by cell."""
    square = np.divide(f**2, variance, out=np.full_like(f, np.inf), where=variance > 0.0)
    factor = np.where(square > 0.0, 1.0 - 2.0 / np.maximum(square, 1e-300), 0.0)
    return np.asarray(f * np.maximum(factor, 0.0))


def change(active: NDArrayBool, probed: FloatArray, baseline: FloatArray, amplitude: float) -> FloatArray:
    """What a unit of the effect changes (N,); 0 out of scope, and where no run gave the cell."""
    return np.nan_to_num(np.where(active, (probed - baseline) / amplitude, 0.0))


class Prober:
    """Runs a simulator at parameters theta and returns means over seeds in the cells of a model's frame."""

    def __init__(self, simulator: Simulator, model: Model, first_seed: int) -> None:
        self._simulator, self._model, self._seed = simulator, model, first_seed

    def means(
        self, theta: FloatArray, effects: Mapping[str, float], seeds: int, active: NDArrayBool
    ) -> FloatArray:
        """Mean cells (N,) at theta (D,) over the runs that give them, NaN where none does; 0 where not `active`
        (N,), whose conditions are not run."""
        frame, model = self._model.frame, self._model
        found = np.zeros(frame.size)
        condition, column = np.array(frame.condition), np.array(frame.column)
        for c in np.unique(condition[active]):
            here = frame.conditions[c]
            u = theta[model.slice(model.materials.index(here.material))]
            point = physical(self._simulator, u[None, :])[0]
            settings = [Setting(point, tuple(effects.items()), self._seed + k) for k in range(seeds)]
            cells = np.flatnonzero(condition == c)
            table = summarise(here.test, self._simulator.run(here, settings))[:, column[cells]]
            seen = np.sum(np.isfinite(table), axis=0)
            found[cells] = np.where(seen > 0, np.nansum(table, axis=0) / np.maximum(seen, 1), np.nan)
        return found

    def fresh(self) -> Prober:
        """The same with seeds of its own."""
        return Prober(self._simulator, self._model, self._seed + 1000)


class Probe(NamedTuple):
    """Means (N,) with an effect at `amplitude`; `whole` where every cell has a number that has one without it."""

    means: FloatArray
    amplitude: float
    whole: bool


def probe(
    prober: Prober,
    theta: FloatArray,
    along: Mapping[str, float],
    amplitude: float,
    seeds: int,
    active: NDArrayBool,
    baseline: FloatArray,
) -> Probe:
    """At `amplitude` times `along` (parts of keys), halved until no cell of `baseline` (N,) is lost.

    The smallest amplitude tried where one is lost in all of them.
    """

    def at(size: float) -> Probe:
        means = prober.means(theta, {key: size * part for key, part in along.items()}, seeds, active)
        return Probe(means, size, not np.any(np.isnan(means) & np.isfinite(baseline)))

    found = at(amplitude)
    for _ in range(_HALVINGS):
        if found.whole:
            break
        found = at(found.amplitude / 2.0)
    return found


def scope_of(effect: Effect, frame: Frame) -> NDArrayBool:
    """The cells (N,) of conditions that the effect acts on."""
    acts = np.array([effect.acts_on(c) for c in frame.conditions], dtype=bool)
    return np.asarray(acts[np.array(frame.condition, dtype=int)], dtype=bool)


def screen(known: Library, prober: Prober, model: Model, theta: FloatArray) -> Fingerprints:
    """All effects at theta (D,), with few seeds."""
    frame = model.frame
    everything = np.ones(frame.size, dtype=bool)
    baseline = prober.fresh().means(theta, {}, BASELINE_SEEDS, everything)
    variance = np.diag(model.run_covariance)
    rows, weights, actives = [], [], []
    for effect in known.effects:
        active = scope_of(effect, frame)
        amplitude = min(_SCREENED_AT * effect.scale, effect.highest)
        for key in effect.keys:
            tried = probe(prober, theta, {key: 1.0}, amplitude, SCREENING_SEEDS, active, baseline)
            weight = (1.0 / SCREENING_SEEDS + 1.0 / BASELINE_SEEDS) / tried.amplitude**2
            f = change(active, tried.means, baseline, tried.amplitude)
            rows.append(shrink(f, weight * variance))
            weights.append(weight)
            actives.append(active)
    keys = tuple(key for effect in known.effects for key in effect.keys)
    return Fingerprints(keys, np.array(rows), np.array(weights), np.array(actives))


def refine(
    prints: Fingerprints, prober: Prober, model: Model, theta: FloatArray, fitted: Mapping[str, float]
) -> Fingerprints:
    """The fingerprints of `fitted` keys at theta and at their fitted amplitudes, with more seeds.

    One whose runs leave cells without a number at every amplitude that is tried stays as it was screened: without
    them it would fit nothing.
    """
    frame = model.frame
    baseline = prober.fresh().means(theta, {}, REFINED_SEEDS, np.ones(frame.size, dtype=bool))
    variance = np.diag(model.run_covariance)
    for key, amplitude in fitted.items():
        active = prints.active[prints.row(key)]
        tried = probe(prober, theta, {key: 1.0}, amplitude, REFINED_SEEDS, active, baseline)
        if not tried.whole:
            continue
        weight = 2.0 / REFINED_SEEDS / tried.amplitude**2
        f = change(active, tried.means, baseline, tried.amplitude)
        prints = prints.replaced(key, shrink(f, weight * variance), weight)
    return prints

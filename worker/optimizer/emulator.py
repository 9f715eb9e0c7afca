"""One emulator for each observable that a study's designs hold: responses, and whatever else every pile yields.

Notation (N designs with a value, d variables)
    u       designs in the unit cube                                    (N, d)
    y       values of one observable, in its unit                       (N,)
    m, s    mean and inflated sd of the noiseless observable, in its unit

The emulator of a response wraps the surrogate that proposes and certifies (outlook.py), with its links to coarse
runs and earlier studies. Any other observable has a surrogate of this study's designs alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from service.domain.observables import OBSERVABLES
from service.domain.search_space import SearchSpace
from worker.optimizer.design import FloatArray
from worker.optimizer.history import Design, History
from worker.optimizer.noise import noise_evidence
from worker.optimizer.surrogate import Surrogate, TrainingSet, fit_hyperparameters, training_set

FEWEST_DESIGNS = 3
# The priors of an observable that is no angle call this share of its spread a degree.
SPREAD_IN_DEGREES = 5.0
# Rows at once: a block of the kernel matrix then stays in the processor's cache, three times as fast as all.
_BLOCK = 256


@dataclass(frozen=True)
class Emulator:
    """What is believed of one observable over the box, in its unit."""

    observable: str
    surrogate: Surrogate

    @property
    def unit(self) -> str:
        return OBSERVABLES[self.observable].unit

    @property
    def designs(self) -> int:
        """Runs of this study that had a value."""
        return int(self.surrogate.data.n.sum())

    @property
    def noise_sd(self) -> float:
        """Of one run, as fitted."""
        return self.surrogate.hyper.noise_sd

    @property
    def inflation(self) -> float:
        """Factor on the sd, from the leave-one-out errors (calibration.md decision 2)."""
        return self.surrogate.inflation

    @property
    def says_enough(self) -> bool:
        """Three designs that differ, or fewer with another test's emulator behind them."""
        y = self.surrogate.data.y
        differ = len(y) >= FEWEST_DESIGNS and bool(np.ptp(y) > 1e-12 * np.abs(y).max())
        return differ or self.surrogate.link is not None

    def predict(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and inflated sd (k,) at u (k, d)."""
        mean, sd = np.empty(len(u)), np.empty(len(u))
        for start in range(0, len(u), _BLOCK):
            rows = slice(start, start + _BLOCK)
            mean[rows], sd[rows] = self.surrogate.predict(u[rows])
        return mean, self.inflation * sd

    def mean(self, u: FloatArray) -> FloatArray:
        """The mean alone (k,)."""
        return np.concatenate([self.surrogate.mean(u[k : k + _BLOCK]) for k in range(0, len(u), _BLOCK)])

    def average(self, u: FloatArray) -> tuple[float, float]:
        """Mean and inflated sd of the average of the observable over the points u (k, d)."""
        mean, covariance = self.surrogate.covariance(u)
        return float(mean.mean()), self.inflation * math.sqrt(max(float(covariance.mean()), 0.0))

    def without(self, left_out: Sequence[int]) -> Emulator:
        """The same hyper-parameters and link, conditioned on all but the rows `left_out` of the training set."""
        data, keep = self.surrogate.data, np.ones(len(self.surrogate.data.y), dtype=bool)
        keep[list(left_out)] = False
        kept = TrainingSet(data.u[keep], data.y[keep], data.n[keep])
        return Emulator(self.observable, Surrogate(kept, self.surrogate.hyper, self.surrogate.link))


def emulators(space: SearchSpace, history: History, besides: Iterable[str] = ()) -> dict[str, Emulator]:
    """An emulator of this study's designs alone for every observable but `besides` that they tell enough of."""
    names = {name for design in history.finished for name in design.results or ()} - set(besides)
    found = {name: own_emulator(space, history, name) for name in OBSERVABLES if name in names}
    return {name: one for name, one in found.items() if one.says_enough}


def own_emulator(space: SearchSpace, history: History, observable: str, least: float = 0.0) -> Emulator:
    """Fitted to the finished designs alone; needs one with a value. `least`: see `unit_of`."""
    data = data_of(space, history.finished, observable)
    unit = unit_of(data, observable, least)
    noise = noise_evidence(history, observable, SPREAD_IN_DEGREES * unit)
    return Emulator(observable, Surrogate(data, fit_hyperparameters(data, noise, unit)))


def data_of(space: SearchSpace, designs: Iterable[Design], observable: str) -> TrainingSet:
    """The designs that have a value of the observable, replicates as means."""
    return training_set(
        (space.to_unit(d.x), d.results[observable])
        for d in designs
        if d.results is not None and observable in d.results
    )


def unit_of(data: TrainingSet, observable: str, least: float = 0.0) -> float:
    """What the priors call a degree, in the observable's unit. `least`: a spread to count with where all values
    are alike; 0 where nobody knows one."""
    if OBSERVABLES[observable].unit == "deg":
        return 1.0
    # Values that are all the same have no scale of their own but their size.
    spread = max(float(np.std(data.y)), least) or 1e-3 * float(np.abs(data.y).max()) or 1.0
    return spread / SPREAD_IN_DEGREES

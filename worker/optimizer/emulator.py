"""One emulator for each observable that a study's designs hold: responses, and whatever else every pile yields.

Notation (N designs with a value, d variables)
    u       designs in the unit cube                                    (N, d)
    y       values of one observable, in its unit                       (N,)
    c       unit conversion: y c is what the surrogate is fitted to, whose priors are in degrees
    sigma   noise sd of one run, pooled over replicates and shrunk towards its prior
    m, s    mean and inflated sd of the noiseless observable, in its unit

Degrees are fitted as they are (c = 1); another unit is scaled to a spread of 5, that of an angle over a box.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from service.domain.observables import OBSERVABLES
from service.domain.search_space import SearchSpace
from worker.optimizer.design import FloatArray
from worker.optimizer.history import History
from worker.optimizer.noise import PRIOR_FREEDOM, NoiseEvidence
from worker.optimizer.surrogate import Surrogate, fit_hyperparameters, training_set

FEWEST_VALUES = 3
SPREAD = 5.0
# Noise of an observable that nothing is known of: this share of the spread of its values.
NOISE_SHARE = 0.1
# Degrees of freedom beside which a few dozen designs do not count.
CERTAIN = 1e6
# Rows at once: a block of the kernel matrix then stays in the processor's cache, three times as fast as all.
_BLOCK = 256

Row = tuple[tuple[float, ...], float]


@dataclass(frozen=True)
class Emulator:
    """What is believed of one observable over the box. `designs` had a value; `noise_sd` in its unit."""

    observable: str
    designs: int
    noise_sd: float
    conversion: float
    surrogate: Surrogate

    @property
    def unit(self) -> str:
        return OBSERVABLES[self.observable].unit

    @property
    def inflation(self) -> float:
        """Factor on the sd, from the leave-one-out errors (calibration.md decision 2)."""
        return self.surrogate.inflation

    def predict(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and inflated sd (k,) at u (k, d)."""
        mean, sd = np.empty(len(u)), np.empty(len(u))
        for start in range(0, len(u), _BLOCK):
            rows = slice(start, start + _BLOCK)
            mean[rows], sd[rows] = self.surrogate.predict(u[rows])
        return mean / self.conversion, self.inflation * sd / self.conversion

    def mean(self, u: FloatArray) -> FloatArray:
        """The mean alone (k,)."""
        return self.predict(u)[0]

    def average(self, u: FloatArray) -> tuple[float, float]:
        """Mean and inflated sd of the average of the observable over the points u (k, d)."""
        mean, covariance = self.surrogate.covariance(u)
        sd = math.sqrt(max(float(covariance.mean()), 0.0))
        return float(mean.mean()) / self.conversion, self.inflation * sd / self.conversion

    def without(self, left_out: Sequence[int]) -> Emulator:
        """The same hyper-parameters, conditioned on all but the rows `left_out` of the training set."""
        data, keep = self.surrogate.data, np.ones(len(self.surrogate.data.y), dtype=bool)
        keep[list(left_out)] = False
        kept = data._replace(u=data.u[keep], y=data.y[keep], n=data.n[keep])
        surrogate = Surrogate(kept, self.surrogate.hyper)
        return Emulator(self.observable, int(kept.n.sum()), self.noise_sd, self.conversion, surrogate)


def emulators(space: SearchSpace, history: History) -> dict[str, Emulator]:
    """An emulator for every observable with at least three values that are not all the same, by name."""
    names = {name for design in history.finished for name in design.results or ()}
    found = {name: emulator(space, history, name) for name in OBSERVABLES if name in names}
    return {name: one for name, one in found.items() if one is not None}


def emulator(space: SearchSpace, history: History, observable: str) -> Emulator | None:
    """The emulator of one observable; None where there is too little to fit."""
    rows: list[Row] = [
        (space.to_unit(design.x), design.results[observable])
        for design in history.finished
        if design.results is not None and observable in design.results
    ]
    values = np.array([y for _, y in rows])
    if len(values) < FEWEST_VALUES or np.ptp(values) <= 1e-12 * np.abs(values).max():
        return None
    in_degrees = OBSERVABLES[observable].unit == "deg"
    conversion = 1.0 if in_degrees else SPREAD / float(values.std())
    noise = noise_sd(rows, history, observable, float(values.std()))
    data = training_set((u, y * conversion) for u, y in rows)
    surrogate = Surrogate(data, fit_hyperparameters(data, _certain(noise * conversion)))
    return Emulator(observable, len(rows), noise, conversion, surrogate)


def _certain(sd: float) -> NoiseEvidence:
    """A noise that the fit leaves as it is."""
    return NoiseEvidence(CERTAIN, CERTAIN * sd**2)


def noise_sd(rows: Sequence[Row], history: History, observable: str, spread: float) -> float:
    """Pooled sd of replicates, earlier ones of the same test included, shrunk towards its prior:
    `sqrt((nu0 s0^2 + sum (n_i - 1) s_i^2) / (nu0 + nu))`."""
    by_u: dict[tuple[float, ...], list[float]] = {}
    for u, y in rows:
        by_u.setdefault(u, []).append(y)
    squares = sum(float(np.sum((np.array(ys) - np.mean(ys)) ** 2)) for ys in by_u.values())
    freedom = float(sum(len(ys) - 1 for ys in by_u.values()))
    if (level := history.noise.get(observable)) is not None:
        squares, freedom = squares + level.freedom * level.sd**2, freedom + level.freedom
    expected = OBSERVABLES[observable].noise_sd
    prior = NOISE_SHARE * spread if expected is None else expected
    return math.sqrt((PRIOR_FREEDOM * prior**2 + squares) / (PRIOR_FREEDOM + freedom))

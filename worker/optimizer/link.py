"""What another test tells of this one: an AR(1) link to coarse runs, or to a stored study of the same test.

Notation (one response; N groups of this study)
    y_i      mean response of group i, n_i runs, noise sd sigma
    m_i      the other test's emulator at the same design
    model    y = rho m + c + delta(u)
    rho      prior N(1, RHO_SD^2); c: prior flat; delta about DELTA_SD before the surrogate knows better

The two fidelities are never pooled: rho and c are regressed on the designs that this study has run (two of them
are runs of designs that the other test has run too), and delta is a surrogate of its own, with a smaller prior.
The emulator counts as a known function; where it errs, delta takes it up, since delta's amplitude is fitted to
what is left. A link that predicts this study's left-out designs worse than their own surrogate gets weight 0.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from worker.optimizer.design import FloatArray
from worker.optimizer.noise import NoiseEvidence
from worker.optimizer.surrogate import (
    DIFFERENCE,
    Hyperparameters,
    Surrogate,
    TrainingSet,
    fit_hyperparameters,
)

RHO_SD = 0.2
DELTA_SD = 1.0
# From so many groups on, leaving one out says more than that two numbers differ.
FEWEST_TO_COMPARE = 4
# Groups that the other test needs before its emulator is asked.
FEWEST_SOURCE = 3


class Source(NamedTuple):
    """Another test: what it is called, and the emulator of its response."""

    name: str
    surrogate: Surrogate


class ScaledMean:
    """`rho m(u)`, the link of a surrogate."""

    def __init__(self, source: Source, rho: float) -> None:
        self.source, self.rho = source, rho

    def __call__(self, u: FloatArray) -> FloatArray:
        return self.rho * self.source.surrogate.mean(u)


class Fit(NamedTuple):
    """What makes a surrogate of its data: its hyper-parameters and the link that was chosen, if any."""

    hyper: Hyperparameters
    source: str | None = None
    rho: float | None = None
    source_hyper: Hyperparameters | None = None

    def as_dict(self) -> dict[str, Any]:
        """JSON."""
        if self.source_hyper is None:
            return self.hyper.as_dict()
        link = {"source": self.source, "rho": self.rho, "hyper": self.source_hyper.as_dict()}
        return {**self.hyper.as_dict(), "link": link}

    @classmethod
    def from_dict(cls, stored: dict[str, Any]) -> Fit:
        hyper, link = Hyperparameters.from_dict(stored), stored.get("link")
        if link is None:
            return cls(hyper)
        return cls(hyper, link["source"], float(link["rho"]), Hyperparameters.from_dict(link["hyper"]))


def regress(data: TrainingSet, m: FloatArray, noise_sd: float, unit: float) -> float:
    """The most likely rho, with c integrated out: weighted least squares on centred values, and the prior."""
    weight = 1.0 / (noise_sd**2 / data.n + (DELTA_SD * unit) ** 2)
    centred_m, centred_y = (v - np.average(v, weights=weight) for v in (m, data.y))
    precision = float(np.sum(weight * centred_m**2)) + 1.0 / RHO_SD**2
    return (float(np.sum(weight * centred_m * centred_y)) + 1.0 / RHO_SD**2) / precision


def linked(data: TrainingSet, source: Source, noise: NoiseEvidence, unit: float) -> Surrogate:
    """The surrogate of the difference, fitted."""
    rho = regress(data, source.surrogate.mean(data.u), noise.sd, unit)
    link = ScaledMean(source, rho)
    return Surrogate(data, fit_hyperparameters(data, noise, unit, DIFFERENCE, link), link)


def best_surrogate(data: TrainingSet, sources: list[Source], noise: NoiseEvidence, unit: float) -> Surrogate:
    """The data's own surrogate, or the linked one that leaves one out best; with few groups the first link."""
    if len(data.y) < FEWEST_TO_COMPARE and sources:
        return linked(data, sources[0], noise, unit)
    own = Surrogate(data, fit_hyperparameters(data, noise, unit))
    others = [linked(data, source, noise, unit) for source in sources]
    return min([own, *others], key=lambda s: s.loo_error)


def fit_of(surrogate: Surrogate) -> Fit:
    """What `refitted` needs to make the same surrogate again."""
    if not isinstance(surrogate.link, ScaledMean):
        return Fit(surrogate.hyper)
    source = surrogate.link.source
    return Fit(surrogate.hyper, source.name, surrogate.link.rho, source.surrogate.hyper)


def refitted(data: TrainingSet, sources: dict[str, TrainingSet], fit: Fit) -> Surrogate:
    """The surrogate of a stored fit."""
    if fit.source is None or fit.rho is None or fit.source_hyper is None:
        return Surrogate(data, fit.hyper)
    source = Source(fit.source, Surrogate(sources[fit.source], fit.source_hyper))
    return Surrogate(data, fit.hyper, ScaledMean(source, fit.rho))

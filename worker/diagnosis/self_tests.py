"""The simulation's own errors, looked for before any effect: time step, stiffness, coarse-graining, number.

Notation (N cells)
    z       change by a self-test at the calibrated parameters over the sd of the measured means    (N,)

A change of the simulation's settings that moves a cell by more than half an sd of what was measured is an error
that a diagnosis would blame on the plant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from service.domain.effects import Library
from worker.diagnosis.fingerprints import Prober
from worker.diagnosis.measured import Measured
from worker.diagnosis.model import Model
from worker.diagnosis.simulator import FloatArray, Simulator

SEEDS = 24
MOST_SHIFT = 0.5
# Some 100 cells are looked at in each of four tests: one beyond this by chance in a thousand diagnoses.
_CERTAIN = 4.5


@dataclass(frozen=True)
class SelfTestOutcome:
    """`shift`: the largest |z| that is certain, 0 where none is; `cell` where, as condition and summary."""

    id: str
    shift: float
    cell: str

    @property
    def passed(self) -> bool:
        return self.shift <= MOST_SHIFT


def run_self_tests(
    simulator: Simulator, known: Library, model: Model, measured: Measured, theta: FloatArray, seed: int
) -> tuple[SelfTestOutcome, ...]:
    """At theta (D,), with 24 seeds each; a shift counts from 4.5 times its sampling error."""
    everything = np.ones(model.frame.size, dtype=bool)
    prober = Prober(simulator, model, seed)
    baseline = prober.fresh().means(theta, {}, SEEDS, everything)
    sampling = np.sqrt(2.0 / SEEDS * np.diag(model.run_covariance))
    sd = np.sqrt(np.diag(measured.S))
    found = []
    for test in known.self_tests:
        moved = np.abs(prober.means(theta, {test.id: test.amplitude}, SEEDS, everything) - baseline)
        shifts = np.where(moved > _CERTAIN * sampling, moved / sd, 0.0)
        worst = int(np.argmax(shifts))
        name = model.frame.conditions[model.frame.condition[worst]].condition
        found.append(SelfTestOutcome(test.id, float(shifts[worst]), f"{name} {model.frame.summary(worst)}"))
    return tuple(found)

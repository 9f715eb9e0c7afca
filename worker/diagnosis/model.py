"""The baseline as the analyser knows it: emulators of every cell over the parameters of all materials.

Notation (M materials, d parameters each, D = M d, N cells)
    theta   parameters of all materials in their unit boxes, one after the other          (D,)
    m       means of the cells at theta                                                   (N,)
    J       slopes of m over theta; a cell answers to its own material only               (N, D)
    E       covariance of the emulators' errors                                           (N, N)
    C       covariance of one run's scatter, block by condition                           (N, N)

Two waves (rule 3): points over the whole box, then points about the re-calibrated parameters. A run may make no
pile (grains that roll off the base leave none): its design teaches nothing and is left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.domain.data_set.records import Condition
from service.domain.errors import InvalidValue
from worker.diagnosis.emulator import Emulator, fit
from worker.diagnosis.measured import Frame
from worker.diagnosis.simulator import FloatArray, Setting, Simulator
from worker.diagnosis.summaries import summarise

# A cell whose summary more of the runs do not give cannot be emulated; nor can a material with fewer whole runs.
_MOST_MISSING = 0.4
LEAST_RUNS = 10


class Runs(NamedTuple):
    """Effect-free runs of one material: designs u (n, d) and summaries (n, m) by condition."""

    u: FloatArray
    tables: Mapping[str, FloatArray]

    def joined(self, other: Runs) -> Runs:
        """Both waves, this one first."""
        tables = {name: np.vstack([t, other.tables[name]]) for name, t in self.tables.items()}
        return Runs(np.vstack([self.u, other.u]), tables)


def materials_of(conditions: Sequence[Condition]) -> tuple[str, ...]:
    """In order of appearance."""
    return tuple(dict.fromkeys(c.material for c in conditions))


def physical(simulator: Simulator, u: FloatArray) -> tuple[tuple[float, ...], ...]:
    """Parameters of unit-cube points u (n, d) clipped to the box."""
    lower = np.array([p.lower for p in simulator.parameters])
    upper = np.array([p.upper for p in simulator.parameters])
    return tuple(tuple(row) for row in (lower + np.clip(u, 0.0, 1.0) * (upper - lower)).tolist())


def run_effect_free(
    simulator: Simulator, conditions: Sequence[Condition], u: FloatArray, first_seed: int
) -> Runs:
    """One run of each condition at each design, seeds counting up from `first_seed`."""
    points = physical(simulator, u)
    settings = [Setting(point, (), first_seed + k) for k, point in enumerate(points)]
    return Runs(u, {c.condition: summarise(c.test, simulator.run(c, settings)) for c in conditions})


@dataclass(frozen=True)
class Model:
    """Emulators by material over the cells of `frame`."""

    frame: Frame
    materials: tuple[str, ...]
    emulators: tuple[Emulator, ...]
    dimension: int
    last_waves: tuple[int, ...]

    @cached_property
    def _cells(self) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.intp]], ...]:
        """Places of each material's cells in the frame."""
        names = np.array([self.frame.conditions[c].material for c in self.frame.condition])
        return tuple(np.flatnonzero(names == material) for material in self.materials)

    def slice(self, material: int) -> slice:
        """Where a material's parameters stand in theta."""
        return slice(material * self.dimension, (material + 1) * self.dimension)

    def mean(self, theta: FloatArray) -> FloatArray:
        """m at theta (D,)."""
        m = np.empty(self.frame.size)
        for k, (cells, emulator) in enumerate(zip(self._cells, self.emulators, strict=True)):
            m[cells] = emulator.mean(theta[None, self.slice(k)])[0]
        return m

    def tangent(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """m and J at theta (D,)."""
        m, J = np.empty(self.frame.size), np.zeros((self.frame.size, len(theta)))
        for k, (cells, emulator) in enumerate(zip(self._cells, self.emulators, strict=True)):
            m[cells], J[cells, self.slice(k)] = emulator.tangent(theta[self.slice(k)])
        return m, J

    def error(self, theta: FloatArray) -> FloatArray:
        """E at theta (D,): errors of one condition are correlated as its runs' scatter is."""
        variance = np.empty(self.frame.size)
        for k, (cells, emulator) in enumerate(zip(self._cells, self.emulators, strict=True)):
            variance[cells] = emulator.predict(theta[None, self.slice(k)])[1][0]
        sd = np.sqrt(variance)
        return np.asarray(self._correlation * np.outer(sd, sd))

    @cached_property
    def run_covariance(self) -> FloatArray:
        """C."""
        sd = np.empty(self.frame.size)
        for cells, emulator in zip(self._cells, self.emulators, strict=True):
            sd[cells] = emulator.run_noise
        return np.asarray(self._correlation * np.outer(sd, sd))

    @cached_property
    def _correlation(self) -> FloatArray:
        """Of the leave-one-out residuals within each condition (N, N), shrunk a little."""
        residuals = np.empty((min(len(e.u) for e in self.emulators), self.frame.size))
        for cells, emulator in zip(self._cells, self.emulators, strict=True):
            residuals[:, cells] = (emulator.left_out / emulator.left_out_sd)[-len(residuals) :]
        product = residuals.T @ residuals
        norm = np.sqrt(np.diag(product))
        correlation = 0.95 * product / np.outer(norm, norm)
        condition = np.array(self.frame.condition)
        correlation[condition[:, None] != condition[None, :]] = 0.0
        np.fill_diagonal(correlation, 1.0)
        return np.asarray(correlation)

    @property
    def coverage(self) -> float:
        """Share of the last wave's runs in their leave-one-out 90 % bands; the worst material's."""
        pairs = zip(self.emulators, self.last_waves, strict=True)
        return min(emulator.coverage(last) for emulator, last in pairs)


def represented(frame: Frame, runs: Mapping[str, Runs]) -> Frame:
    """The cells that most runs give; what the simulator cannot say of a condition cannot be compared."""
    keep = np.empty(frame.size, dtype=bool)
    for cell, (c, k) in enumerate(zip(frame.condition, frame.column, strict=True)):
        condition = frame.conditions[c]
        column = runs[condition.material].tables[condition.condition][:, k]
        keep[cell] = np.mean(~np.isfinite(column)) <= _MOST_MISSING
    return frame.subset(keep)


def build_model(
    frame: Frame,
    runs: Mapping[str, Runs],
    dimension: int,
    last_wave: int,
    materials: tuple[str, ...] | None = None,
) -> Model:
    """From effect-free runs by material; the last `last_wave` of each are the wave that is checked. `materials`
    where theta has others than the frame.

    Raises InvalidValue where fewer than LEAST_RUNS runs of a material give all of its cells.
    """
    materials = materials_of(frame.conditions) if materials is None else materials
    emulators, last_waves = [], []
    for material in materials:
        pairs = [
            (frame.conditions[c].condition, k)
            for c, k in zip(frame.condition, frame.column, strict=True)
            if frame.conditions[c].material == material
        ]
        mine = runs[material]
        columns = [mine.tables[name][:, k] for name, k in pairs]
        Y = np.column_stack(columns) if columns else np.empty((len(mine.u), 0))
        whole: NDArray[np.bool_] = np.all(np.isfinite(Y), axis=1)
        if whole.sum() < LEAST_RUNS:
            allowed = f"at least {LEAST_RUNS} that make a pile in all conditions"
            raise InvalidValue(f"simulated runs of {material}", int(whole.sum()), allowed)
        emulators.append(fit(mine.u[whole], Y[whole]))
        last_waves.append(int(whole[-last_wave:].sum()))
    return Model(frame, materials, tuple(emulators), dimension, tuple(last_waves))

"""Thresholds from effect-free simulator runs that pass through the whole analysis (rule 8).

Notation (B pseudo-plants)
    theta_b   parameters drawn from the posterior of the re-calibration
    x_b       replicates: effect-free runs at theta_b, as many as were measured, the same cells missing, brought to
              the measured scatter with resampled residuals of the plant's own replicates, plus a draw of the floor
    T_b       the statistics of each; p of a value its rank among them, (1 + count of larger) / (1 + B)
    min-p     the smallest p of the three statistics, itself ranked among those of the null runs

Pseudo-plants share a few points theta, each with a bank of runs from which replicates are drawn.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from service.domain.errors import InvalidValue
from worker.diagnosis.analysis import Analysis, Setup, Statistics, analyse
from worker.diagnosis.calibration import calibrate
from worker.diagnosis.measured import Frame, Measured, Tables, measure
from worker.diagnosis.model import Model, physical
from worker.diagnosis.simulator import FloatArray, Setting, Simulator
from worker.diagnosis.summaries import summarise

LEAST_PLANTS = 100
POINTS = 8
BANK = 12
# Small against a step of p, large against rounding.
_TIE, _FARTHEST = 1e-9, 1e5


@dataclass(frozen=True)
class NullCalibration:
    """Statistics (B, 3) of effect-free pseudo-plants; `key` (see design_key) says for what it holds.

    Raises InvalidValue with fewer than 100.
    """

    key: str
    statistics: FloatArray

    def __post_init__(self) -> None:
        if len(self.statistics) < LEAST_PLANTS:
            raise InvalidValue("null calibration", len(self.statistics), f"at least {LEAST_PLANTS} null runs")

    def p_values(self, found: Statistics) -> FloatArray:
        """p (3,) of each statistic."""
        larger = np.sum(self.statistics >= np.array(found), axis=0)
        return np.asarray((1.0 + larger) / (1.0 + len(self.statistics)))

    def p_value(self, found: Statistics) -> float:
        """p of the smallest of the three p values; a tie goes by how far out the statistic lies."""
        smallest = np.min(self.p_values(found)) - _TIE * np.max(self._excess(np.array(found)))
        return float((1.0 + np.sum(self._smallest <= smallest)) / (1.0 + len(self.statistics)))

    @cached_property
    def _smallest(self) -> FloatArray:
        """min-p of the null runs (B,), each ranked among the others."""
        larger = np.sum(self.statistics[None, :, :] > self.statistics[:, None, :], axis=1)
        p = (1.0 + larger) / (1.0 + len(self.statistics))
        return np.asarray(np.min(p, axis=1) - _TIE * np.max(self._excess(self.statistics), axis=1))

    @cached_property
    def _spread(self) -> FloatArray:
        return np.asarray(np.quantile(self.statistics, [0.5, 0.9], axis=0))

    def _excess(self, statistics: FloatArray) -> FloatArray:
        middle, high = self._spread
        return np.asarray(np.minimum((statistics - middle) / np.maximum(high - middle, 1e-9), _FARTHEST))

    def quantile(self, statistic: int, q: float) -> float:
        """The null's q-quantile of one of the three."""
        return float(np.quantile(self.statistics[:, statistic], q, method="higher"))


def calibrate_null(
    key: str,
    setup: Setup,
    simulator: Simulator,
    measured: Measured,
    tables: Tables,
    found: Analysis,
    plants: int,
    seed: int,
) -> NullCalibration:
    """`plants` pseudo-plants about the analysis `found` of the data, whose replicates are `tables`; holds for
    `key`."""
    stream = np.random.default_rng(np.random.SeedSequence([seed, 8]))
    points = _posterior_points(found, stream)
    drawn = [_bank(simulator, setup.model, point, seed + 7919 * (k + 1)) for k, point in enumerate(points)]
    banks = [bank for bank in drawn if all(map(len, bank.values()))]
    if not banks:
        raise InvalidValue(
            "simulated runs", "none that makes a pile in all conditions", "some of the null runs"
        )
    root = _root(setup.floor)
    shapes = [_Shape(c, measured, tables, setup.model) for c in range(len(measured.frame.conditions))]
    statistics = []
    for b in range(plants):
        bank = banks[b % len(banks)]
        tables_b = {shape.name: shape.draw(bank[shape.name], stream) for shape in shapes}
        pseudo = aligned(measure(measured.frame.conditions, tables_b, pooled=setup.pooled), setup.model.frame)
        y = pseudo.y + root @ stream.standard_normal(len(root))
        theta = calibrate(setup.model, y, pseudo.S + setup.floor, found.problem.theta)
        statistics.append(analyse(setup, y, pseudo.S, theta).statistics)
    return NullCalibration(key, np.array(statistics))


def design_key(measured: Measured, setup: Setup, made_by: Sequence[object]) -> str:
    """sha256 of the design (conditions, cells, replicates), the library and `made_by`: whatever else the null runs
    depend on, with a repr of its own for each value. Sixty-four digits, however large the design."""
    cells = [
        (repr(measured.frame.conditions[c].settings), measured.frame.summary(i), int(measured.runs[i]))
        for i, c in enumerate(measured.frame.condition)
    ]
    text = repr((setup.known.name, sorted(cells), setup.pooled, *made_by))
    return hashlib.sha256(text.encode()).hexdigest()


def aligned(measured: Measured, frame: Frame) -> Measured:
    """The cells of `frame`, in its order. Raises KeyError where one was not measured."""
    place = {
        (c, k): i
        for i, (c, k) in enumerate(zip(measured.frame.condition, measured.frame.column, strict=True))
    }
    keep = [place[cell] for cell in zip(frame.condition, frame.column, strict=True)]
    return Measured(
        frame,
        measured.y[keep],
        measured.S[np.ix_(keep, keep)],
        measured.run_sd[keep],
        measured.runs[keep],
        measured.scatter,
    )


def _posterior_points(found: Analysis, stream: np.random.Generator) -> FloatArray:
    root = _root(found.problem.posterior)
    normal = stream.standard_normal((POINTS, len(root)))
    return np.clip(found.problem.theta + normal @ root.T, 0.0, 1.0)


def _root(covariance: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _bank(simulator: Simulator, model: Model, theta: FloatArray, first_seed: int) -> dict[str, FloatArray]:
    """Effect-free runs (12, m) of each condition at one point; fewer where one gives no pile."""
    found = {}
    place, column = np.array(model.frame.condition), np.array(model.frame.column)
    for k, c in enumerate(model.frame.conditions):
        u = theta[model.slice(model.materials.index(c.material))]
        point = physical(simulator, u[None, :])[0]
        settings = [Setting(point, (), first_seed + k) for k in range(BANK)]
        table = summarise(c.test, simulator.run(c, settings))
        found[c.condition] = table[np.isfinite(table[:, column[place == k]]).all(axis=1)]
    return found


class _Shape:
    """How the replicates of one condition were measured: missing cells, and what scatter the simulator lacks."""

    def __init__(self, c: int, measured: Measured, tables: Tables, model: Model) -> None:
        frame = model.frame
        cells = np.flatnonzero(np.array(frame.condition) == c)
        here = frame.conditions[c]
        self.name = here.condition
        self._columns = np.array(frame.column, dtype=int)[cells]
        self._seen = np.isfinite(tables[here.condition])
        run = np.diag(model.run_covariance)[cells]
        self._lacking = np.sqrt(np.maximum(measured.run_sd[cells] ** 2 - run, 0.0))
        self._pool = np.nan_to_num(measured.scatter[here.test].pool)

    def draw(self, bank: FloatArray, stream: np.random.Generator) -> FloatArray:
        """Replicates (n, m) of a pseudo-plant from a bank of runs (12 or less, m)."""
        n = len(self._seen)
        x = bank[stream.choice(len(bank), n, replace=n > len(bank))].copy()
        drawn = self._pool[stream.choice(len(self._pool), n)]
        x[:, self._columns] += self._lacking * drawn[:, self._columns]
        return np.where(self._seen, x, np.nan)

"""What was measured, as summaries: the cells of a data set and how far replicates scatter (rule 2).

Notation (C conditions, n replicates, m summaries of a test type, N cells = summaries of conditions that were seen)
    x       summaries of one condition                                           (n, m), NaN where missing
    y       means of the winsorised replicates                                   (N,)
    s       sd of one run, pooled over the conditions of a test type             (N,)
    phi     how much more a condition scatters than its test type                (C,)
    R       correlation of summaries within a run, pooled, shrunk to identity    (m, m)
    S       covariance of y: s phi R phi s / n, block by block                   (N, N)
    nu      degrees of freedom behind s
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from service.domain.data_set.columns import TESTS
from service.domain.data_set.records import Condition, DataSet
from worker.diagnosis.simulator import FloatArray, Outcomes, Surfaces
from worker.diagnosis.summaries import LOGARITHM_OF, NAMES, PLAIN_OF, summarise

WINSOR = 3.5
_NORMAL_MAD = 1.4826
# A condition's own scatter counts against the pooled one as if that came from so many degrees of freedom.
_OWN_SCATTER_FREEDOM = 20.0
_LEAST_FREEDOM = 4
_NO_SCATTER = 1e-12

Tables = Mapping[str, FloatArray]


@dataclass(frozen=True)
class Frame:
    """The cells in order: `condition` (N,) indexes `conditions`, `column` (N,) the summaries of its test."""

    conditions: tuple[Condition, ...]
    condition: tuple[int, ...]
    column: tuple[int, ...]

    @property
    def size(self) -> int:
        return len(self.condition)

    def summary(self, cell: int) -> str:
        return NAMES[self.conditions[self.condition[cell]].test][self.column[cell]]

    @property
    def summaries(self) -> set[tuple[str, int]]:
        """Test and column of all cells."""
        tests = (self.conditions[c].test for c in self.condition)
        return set(zip(tests, self.column, strict=True))

    @property
    def trained(self) -> NDArrayBool:
        """Which cells are of training conditions (N,)."""
        return np.array([not self.conditions[c].holdout for c in self.condition], dtype=bool)

    def of(self, tables: Tables) -> FloatArray:
        """The cells (n, N) of tables (n, m) by condition name; all with the same n."""
        pairs = zip(self.condition, self.column, strict=True)
        return np.column_stack([tables[self.conditions[c].condition][:, k] for c, k in pairs])

    def subset(self, keep: NDArrayBool) -> Frame:
        """The same conditions, fewer cells."""
        kept = np.flatnonzero(keep)
        return Frame(
            self.conditions,
            tuple(self.condition[i] for i in kept),
            tuple(self.column[i] for i in kept),
        )


NDArrayBool = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


@dataclass(frozen=True)
class Scatter:
    """Of one test type: `sd` (m,) of one run, `correlation` (m, m), `freedom` (m,) behind each sd, and `pool`
    (k, m), the standardised residuals of all runs, NaN where missing."""

    sd: FloatArray
    correlation: FloatArray
    freedom: FloatArray
    pool: FloatArray


@dataclass(frozen=True)
class Measured:
    """Means `y` (N,) with covariance `S` (N, N); `run_sd` (N,) of one run; `runs` (N,) behind each mean."""

    frame: Frame
    y: FloatArray
    S: FloatArray
    run_sd: FloatArray
    runs: FloatArray
    scatter: Mapping[str, Scatter]

    @property
    def freedom(self) -> float:
        """The median over the cells of the degrees of freedom behind their sd."""
        tests = [self.frame.conditions[c].test for c in self.frame.condition]
        pairs = zip(tests, self.frame.column, strict=True)
        return float(np.median([self.scatter[test].freedom[k] for test, k in pairs]))


def replicate_tables(data: DataSet) -> dict[str, FloatArray]:
    """Summaries (n, m) of the replicates of each condition by its name."""
    values: dict[tuple[str, str], dict[str, float]] = {}
    for o in data.observations:
        values.setdefault((o.condition, o.replicate), {})[o.observable] = o.value
    surfaces = {
        (p.condition, p.replicate): Surfaces(np.array(p.theta_deg), np.array(p.r_m), np.array([p.h_m]))
        for p in data.profiles
    }
    replicates = data.replicates
    found = {}
    for c in data.conditions:
        rows = []
        for name in replicates[c.condition]:
            seen = {k: np.array([v]) for k, v in values.get((c.condition, name), {}).items()}
            rows.append(summarise(c.test, Outcomes(seen, surfaces.get((c.condition, name)))))
        found[c.condition] = np.vstack(rows) if rows else np.empty((0, len(NAMES[c.test])))
    return found


def stated_sd(data: DataSet) -> dict[str, FloatArray]:
    """The sensors' stated sd (m,) of each condition's summaries, 0 where none is stated.

    Only of summaries that are one observable or its logarithm; the others average over many readings.
    """
    found = {c.condition: np.zeros(len(NAMES[c.test])) for c in data.conditions}
    tests = {c.condition: c.test for c in data.conditions}
    for o in data.observations:
        if o.sensor_sd is None:
            continue
        test = tests[o.condition]
        for k, name in enumerate(NAMES[test]):
            if PLAIN_OF[test].get(name) == o.observable:
                found[o.condition][k] = max(found[o.condition][k], o.sensor_sd)
            elif LOGARITHM_OF[test].get(name) == o.observable:
                found[o.condition][k] = max(found[o.condition][k], o.sensor_sd / o.value)
    return found


def measure(
    conditions: Sequence[Condition], tables: Tables, stated: Tables | None = None, pooled: bool = True
) -> Measured:
    """Cells, their means and their covariance, from the replicates of each condition.

    A summary whose scatter is unknown (no two values in any condition, or all alike without a stated sd) is left
    out: a misfit is only one against the scatter. `pooled` False is an ablation: each condition's own scatter,
    without correlations.
    """
    parts = [_of_test(test, conditions, tables, stated, pooled) for test in TESTS]
    scatter = dict(zip(TESTS, (part.scatter for part in parts), strict=True))
    places = [
        (c, k, part, row)
        for part in parts
        for row, c in enumerate(part.conditions)
        for k in np.flatnonzero((part.runs[row] > 0) & part.known).tolist()
    ]
    places.sort(key=lambda place: place[:2])
    frame = Frame(tuple(conditions), tuple(c for c, *_ in places), tuple(k for _, k, *_ in places))
    y, sd, runs = (
        np.array([getattr(part, name)[row, k] for _, k, part, row in places]) for name in ("y", "sd", "runs")
    )
    S = np.zeros((len(places), len(places)))
    condition, column = np.array(frame.condition, dtype=int), np.array(frame.column, dtype=int)
    for part in parts:
        for c in part.conditions:
            own = np.flatnonzero(condition == c)
            columns = column[own]
            # Student's t with nu degrees of freedom has the variance nu / (nu - 2).
            wide = np.sqrt(part.scatter.freedom[columns] / (part.scatter.freedom[columns] - 2.0))
            of_mean = sd[own] / np.sqrt(runs[own]) * wide
            R = part.scatter.correlation[np.ix_(columns, columns)] if pooled else np.eye(len(own))
            S[np.ix_(own, own)] = R * np.outer(of_mean, of_mean)
    return Measured(frame, y, S, sd, runs, scatter)


class _Part(NamedTuple):
    """Of one test type: its conditions' numbers, their means, sds of a run and counts (C, m), which summaries have
    a known scatter (m,), and the scatter."""

    conditions: list[int]
    y: FloatArray
    sd: FloatArray
    runs: FloatArray
    known: NDArrayBool
    scatter: Scatter


def _of_test(
    test: str, conditions: Sequence[Condition], tables: Tables, stated: Tables | None, pooled: bool
) -> _Part:
    m = len(NAMES[test])
    mine = [c for c, condition in enumerate(conditions) if condition.test == test]
    x = _stacked([tables[conditions[c].condition] for c in mine], m)
    sensor = np.zeros((len(mine), m))
    if stated is not None and mine:
        sensor = np.array([stated[conditions[c].condition] for c in mine])
    scatter = _scatter(x, sensor)
    runs = np.sum(np.isfinite(x), axis=1).astype(float)
    pulled = winsorised(x, scatter.sd)
    y = _mean(pulled)
    squares = np.nansum((pulled - y[:, None, :]) ** 2, axis=1)
    if pooled:
        phi = _own_factor(squares, runs, scatter.sd)
        sd = scatter.sd * phi[:, None]
    else:
        sd = np.maximum(np.sqrt(squares / np.maximum(runs - 1.0, 1.0)), 1e-3 * scatter.sd)
    known = (scatter.sd > 0.0) & (scatter.freedom >= _LEAST_FREEDOM)
    return _Part(mine, y, np.maximum(sd, sensor), runs, known, scatter)


def _stacked(tables: Sequence[FloatArray], m: int) -> FloatArray:
    """Replicates of several conditions (C, n, m), filled up with NaN."""
    most = max((len(table) for table in tables), default=0)
    found = np.full((len(tables), most, m), np.nan)
    for row, table in enumerate(tables):
        found[row, : len(table)] = table
    return found


def winsorised(x: FloatArray, sd: FloatArray) -> FloatArray:
    """Replicates (C, n, m) pulled in to 3.5 sd (m,) about their median."""
    middle = _median(x)[:, None, :]
    return np.clip(x, middle - WINSOR * sd, middle + WINSOR * sd)


def _own_factor(squares: FloatArray, runs: FloatArray, sd: FloatArray) -> FloatArray:
    """phi (C,) of each condition: its scatter over the pooled one, shrunk to 1."""
    freedom = np.sum(np.where(sd > 0.0, np.maximum(runs - 1.0, 0.0), 0.0), axis=1)
    ratio = np.sum(np.divide(squares, sd**2, out=np.zeros_like(squares), where=sd > 0.0), axis=1)
    return np.asarray(np.sqrt((_OWN_SCATTER_FREEDOM + ratio) / (_OWN_SCATTER_FREEDOM + freedom)))


def _scatter(x: FloatArray, sensor: FloatArray) -> Scatter:
    """Pooled over the conditions of x (C, n, m); `sensor` (C, m) are stated sds."""
    m = x.shape[2]
    if not x.size:
        return Scatter(np.zeros(m), np.eye(m), np.zeros(m), np.empty((0, m)))
    seen = np.sum(np.isfinite(x), axis=1)
    freedom = np.sum(np.maximum(seen - 1, 0), axis=0).astype(float)
    enlarged = np.sqrt(seen / np.maximum(seen - 1, 1))
    spread = ((x - _median(x)[:, None, :]) * enlarged[:, None, :]).reshape(-1, m)
    mad = np.nan_to_num(_NORMAL_MAD * _median(np.abs(spread)[None])[0])
    pulled = winsorised(x, np.maximum(mad, _NO_SCATTER))
    squares = np.nansum((pulled - _mean(pulled)[:, None, :]) ** 2, axis=(0, 1))
    sd = np.sqrt(squares / np.maximum(freedom, 1.0))
    # A sensor is never better than it says, however well a few replicates agree.
    sd = np.maximum(sd, np.min(sensor, axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        pool = np.where(sd > _NO_SCATTER, spread / sd, np.nan)
    pool = pool[np.isfinite(pool).any(axis=1)]
    return Scatter(np.where(sd > _NO_SCATTER, sd, 0.0), _correlation(pool), freedom, pool)


def _median(x: FloatArray) -> FloatArray:
    """Of what is not NaN along the middle axis of x (C, n, m); NaN, without a warning, where nothing is."""
    if not x.shape[1]:
        return np.full((len(x), x.shape[2]), np.nan)
    ordered = np.sort(x, axis=1)  # NaN last
    count = np.sum(np.isfinite(x), axis=1)[:, None, :]
    lower = np.take_along_axis(ordered, np.maximum(count - 1, 0) // 2, axis=1)
    upper = np.take_along_axis(ordered, np.minimum(count // 2, x.shape[1] - 1), axis=1)
    return np.where(count > 0, 0.5 * (lower + upper), np.nan)[:, 0, :]


def _mean(x: FloatArray) -> FloatArray:
    """As `_median`, the mean."""
    count = np.sum(np.isfinite(x), axis=1)
    return np.where(count > 0, np.nansum(x, axis=1) / np.maximum(count, 1), np.nan)


def _correlation(pool: FloatArray) -> FloatArray:
    """Pooled correlation of standardised residuals (k, m), winsorised, shrunk to the identity by m / (m + k)."""
    m = pool.shape[1]
    filled = np.nan_to_num(np.clip(pool, -WINSOR, WINSOR))
    seen = np.isfinite(pool).astype(float)
    products = filled.T @ filled
    norm = np.sqrt(np.outer(np.diag(products), np.diag(products)))
    counts = seen.T @ seen
    raw = np.divide(products, norm, out=np.zeros((m, m)), where=norm > 0.0)
    weight = counts / (counts + m)
    shrunk = raw * weight
    np.fill_diagonal(shrunk, 1.0)
    values, vectors = np.linalg.eigh(shrunk)
    repaired = (vectors * np.maximum(values, 0.05)) @ vectors.T
    scale = np.sqrt(np.diag(repaired))
    return np.asarray(repaired / np.outer(scale, scale))

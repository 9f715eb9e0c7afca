"""Which parameter moves a response: Sobol indices, correlations, main effects, slices; all on the emulator.

Notation (L levels, d variables, q points of the other variables)
    f(u)      emulator mean over the box, inputs uniform
    S_j, T_j  first-order and total Sobol index of variable j (Saltelli 2010, through SciPy)
    M_j(l)    main effect: average of f with u_j held at level l, the others over the box            (L,)
    rho_j     Spearman's rank correlation of the designs' values with the response
Errors: of S and T, SciPy's bootstrap over the points (90 %) and the emulator's own, by a delete-a-group jackknife
over the designs (Shao and Wu 1989: sqrt((g - 1)/g sum (S_i - mean)^2) for g groups), both half-widths at 90 %.
Bands of main effects and slices are the inflated sd of the emulator. With few designs a weak parameter's effect
may be nothing but the emulator's prior: that is what the second error shows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import sobol_indices as sobol_indices_of
from scipy.stats import spearmanr, uniform

from service.domain.search_space import SearchSpace, Variable
from service.domain.study import StudySpec
from worker.optimizer.design import FloatArray, X, generator, sobol
from worker.optimizer.emulator import Emulator

BASE = 1024
JACKKNIFE_BASE = 256
GROUPS = 10
LEVELS = 11
OTHERS = 64
SLICE_LEVELS = 41
Z_90 = 1.6448536269514722
_STREAM = 101


@dataclass(frozen=True)
class Effect:
    """`values` (physical) and `means` draw the main effect, `sds` its band; `swing`: last less first.

    `variance_share` and `total_share` are the Sobol indices; `*_error` the 90 % half-widths from sampling, and
    `*_emulator_error` those from the designs (nan with too few). `rank_correlation` is the designs' own, with
    its p value; nan with fewer than three.
    """

    name: str
    values: tuple[float, ...]
    means: tuple[float, ...]
    sds: tuple[float, ...]
    swing: float
    variance_share: float
    variance_share_error: float
    variance_share_emulator_error: float
    total_share: float
    total_share_error: float
    total_share_emulator_error: float
    rank_correlation: float
    p_value: float


@dataclass(frozen=True)
class Slice:
    """A cut through the response surface at `through`: mean and sd along `name`, or over two variables as rows."""

    names: tuple[str, ...]
    axes: tuple[tuple[float, ...], ...]
    means: FloatArray
    sds: FloatArray


def effects(spec: StudySpec, emulator: Emulator) -> tuple[Effect, ...]:
    """One effect for each variable, in their order."""
    first, total, first_error, total_error = sobol_indices(emulator, spec.space, BASE, spec.seed)
    first_own, total_own = _jackknife(emulator, spec.space, spec.seed)
    found = []
    for j, variable in enumerate(spec.space.variables):
        values, means, sds = main_effect(emulator, spec.space, j, spec.seed)
        rho, p = _rank_correlation(emulator, j)
        found.append(
            Effect(
                name=variable.name,
                values=values,
                means=means,
                sds=sds,
                swing=means[-1] - means[0],
                variance_share=float(first[j]),
                variance_share_error=float(first_error[j]),
                variance_share_emulator_error=float(first_own[j]),
                total_share=float(total[j]),
                total_share_error=float(total_error[j]),
                total_share_emulator_error=float(total_own[j]),
                rank_correlation=rho,
                p_value=p,
            )
        )
    return tuple(found)


def sobol_indices(
    emulator: Emulator, space: SearchSpace, base: int, seed: int, resamples: int = 100
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """S, T and their bootstrap half-widths at 90 %, each (d,); `base` is a power of two."""
    d = space.dimension
    if d == 1:
        return np.ones(1), np.ones(1), np.zeros(1), np.zeros(1)

    middle = float(emulator.mean(np.full((1, d), 0.5))[0])

    calls: list[FloatArray] = []

    def values(points: FloatArray) -> FloatArray:
        """(1, n) at points (d, n), less the middle's; what is rounding error of a constant is made 0."""
        found = emulator.mean(points.T) - middle
        calls.append(np.where(np.abs(found) > 1e-9 * max(abs(middle), 1e-9), found, 0.0)[None, :])
        return calls[-1].copy()

    found = sobol_indices_of(func=values, n=base, dists=[uniform()] * d, rng=generator(_STREAM, seed))
    first, total = np.ravel(found.first_order), np.ravel(found.total_order)
    if not resamples or not np.any(total):
        return first, total, np.zeros(d), np.zeros(d)
    # Not by the result's own `bootstrap`, whose random numbers have no seed.
    f_a, f_b, f_ab = calls[0], calls[1], np.moveaxis(calls[2].reshape(1, base, d), -1, 0)
    draws = generator(_STREAM, seed, 1).integers(base, size=(resamples, base))
    again = [
        sobol_indices_of(func={"f_A": f_a[:, k], "f_B": f_b[:, k], "f_AB": f_ab[:, :, k]}, n=base)
        for k in draws
    ]
    half = [
        0.5
        * np.ptp(np.quantile([np.ravel(getattr(one, name)) for one in again], [0.05, 0.95], axis=0), axis=0)
        for name in ("first_order", "total_order")
    ]
    return first, total, half[0], half[1]


def _jackknife(emulator: Emulator, space: SearchSpace, seed: int) -> tuple[FloatArray, FloatArray]:
    """90 % half-widths (d,) of S and T when groups of designs are left out; nan with fewer designs than groups."""
    designs = len(emulator.surrogate.data.y)
    if designs < GROUPS:
        unknown = np.full(space.dimension, np.nan)
        return unknown, unknown
    rows = [
        sobol_indices(emulator.without(range(k, designs, GROUPS)), space, JACKKNIFE_BASE, seed, resamples=0)[
            :2
        ]
        for k in range(GROUPS)
    ]
    first, total = np.array([r[0] for r in rows]), np.array([r[1] for r in rows])
    spread = [np.sqrt((GROUPS - 1) * np.var(a, axis=0)) for a in (first, total)]
    return Z_90 * spread[0], Z_90 * spread[1]


def main_effect(
    emulator: Emulator, space: SearchSpace, j: int, seed: int
) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    """Physical values of variable j, M_j there, and the inflated sd of that average."""
    levels = (np.arange(LEVELS) + 0.5) / LEVELS
    others = sobol(space.dimension, OTHERS, _STREAM, seed)
    rows = []
    for level in levels:
        held = others.copy()
        held[:, j] = level
        rows.append(emulator.average(held))
    means, sds = zip(*rows, strict=True)
    return _physical(space.variables[j], levels), tuple(means), tuple(sds)


def _rank_correlation(emulator: Emulator, j: int) -> tuple[float, float]:
    data = emulator.surrogate.data
    if len(data.y) < 3 or np.ptp(data.u[:, j]) == 0.0:
        return float("nan"), float("nan")
    found = spearmanr(data.u[:, j], data.y)
    return float(found.statistic), float(found.pvalue)


def slice_along(emulator: Emulator, space: SearchSpace, through: X, j: int) -> Slice:
    """The response along variable j, the others as in `through`."""
    levels = np.linspace(0.0, 1.0, SLICE_LEVELS)
    u = np.tile(np.array(space.to_unit(through)), (len(levels), 1))
    u[:, j] = levels
    mean, sd = emulator.predict(u)
    variable = space.variables[j]
    return Slice((variable.name,), (_physical(variable, levels),), mean, sd)


def slice_over(emulator: Emulator, space: SearchSpace, through: X, pair: tuple[int, int]) -> Slice:
    """The response over two variables, means and sds (rows along the first, columns along the second)."""
    levels = np.linspace(0.0, 1.0, 21)
    first, second = np.meshgrid(levels, levels, indexing="ij")
    u = np.tile(np.array(space.to_unit(through)), (first.size, 1))
    u[:, pair[0]], u[:, pair[1]] = first.ravel(), second.ravel()
    mean, sd = emulator.predict(u)
    chosen = [space.variables[j] for j in pair]
    axes = tuple(_physical(v, levels) for v in chosen)
    return Slice(tuple(v.name for v in chosen), axes, mean.reshape(first.shape), sd.reshape(first.shape))


def _physical(variable: Variable, levels: FloatArray) -> tuple[float, ...]:
    return tuple(float(variable.lower + v * (variable.upper - variable.lower)) for v in levels)

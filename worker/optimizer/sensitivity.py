"""Which parameter moves the angle: correlations and main effects over the surrogate.

Notation (k Sobol points of the box, L levels, d variables)
    m(u)      surrogate mean, degrees
    M_j(l)    main effect: mean of m with u_j held at level l, the others over the box    (L,)
    S_j       Var_l M_j(l) / Var m: share of the angle's variance that u_j explains alone (first Sobol index)
    rho_j     Spearman's rank correlation of u_j and m over the box
These describe the surrogate; with few designs a weak parameter's effect may be nothing but its prior.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import spearmanr

from service.domain.study import StudySpec
from worker.optimizer.design import FloatArray, sobol
from worker.optimizer.history import History
from worker.optimizer.outlook import Outlook, build_outlook

POINTS = 1024
LEVELS = 11
_STREAM = 101


@dataclass(frozen=True)
class Effect:
    """`values` (physical) and `angles_deg` draw the main effect; `swing_deg`: last less first."""

    name: str
    values: tuple[float, ...]
    angles_deg: tuple[float, ...]
    swing_deg: float
    variance_share: float
    rank_correlation: float


def sensitivity(spec: StudySpec, history: History) -> tuple[Effect, ...] | None:
    """One effect for each variable, in their order; None before any angle."""
    if not history.succeeded:
        return None
    outlook = build_outlook(spec, history)
    u = sobol(spec.space.dimension, POINTS, _STREAM, spec.seed)
    m, _ = outlook.surrogate.predict(u)
    return tuple(_effect(outlook, u, m, j) for j in range(spec.space.dimension))


def _effect(outlook: Outlook, u: FloatArray, m: FloatArray, j: int) -> Effect:
    variable = outlook.spec.space.variables[j]
    levels = (np.arange(LEVELS) + 0.5) / LEVELS
    means = []
    for level in levels:
        held = u.copy()
        held[:, j] = level
        means.append(float(np.mean(outlook.surrogate.predict(held)[0])))
    total = float(np.var(m))
    return Effect(
        name=variable.name,
        values=tuple(float(variable.lower + v * (variable.upper - variable.lower)) for v in levels),
        angles_deg=tuple(means),
        swing_deg=means[-1] - means[0],
        variance_share=float(np.var(means)) / total if total > 0.0 else 0.0,
        rank_correlation=float(spearmanr(u[:, j], m).statistic),
    )

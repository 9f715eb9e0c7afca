"""Two objectives at once, both to be small: the set that nothing beats, and one number of two by weights.

Notation: f (N, M) objectives of N designs; w (M,) weights that sum to 1; f is scaled to 0..1 over its own range.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from demcore.errors import InputError
from worker.optimizer.design import FloatArray

# Share of the plain sum in the augmented Tchebycheff function (Knowles 2006, ParEGO, eq. 2).
AUGMENTED = 0.05


def pareto_set(f: FloatArray) -> list[int]:
    """Rows that no other row beats: none is as small in every objective and smaller in one; by the first one."""
    kept = [
        i
        for i in range(len(f))
        if not any((f[j] <= f[i]).all() and (f[j] < f[i]).any() for j in range(len(f)))
    ]
    return sorted(kept, key=lambda i: (f[i, 0], i))


def scaled(f: FloatArray) -> FloatArray:
    """(N, M) from 0, the smallest, to 1, the largest; an objective that is the same everywhere is 0."""
    low, span = f.min(axis=0), np.ptp(f, axis=0)
    return np.asarray((f - low) / np.where(span > 0.0, span, 1.0))


def tchebycheff(f: FloatArray, weights: Sequence[float]) -> FloatArray:
    """(N,) the largest weighted objective and a little of their sum, of objectives scaled to 0..1 (ParEGO)."""
    weighted = scaled(f) * np.array(weights)
    return np.asarray(weighted.max(axis=1) + AUGMENTED * weighted.sum(axis=1))


def pick(f: FloatArray, weights: Sequence[float]) -> int:
    """The row that an engineer with these weights takes: of the Pareto set, the smallest weighted one. Raises
    InputError for weights that are not one for each objective, not negative, and some positive."""
    w = np.array(weights, float)
    if w.shape != (f.shape[1],) or not (w >= 0.0).all() or w.sum() <= 0.0:
        raise InputError("weights", list(weights), f"{f.shape[1]} numbers, none negative, one positive")
    front = pareto_set(f)
    return front[int(np.argmin(tchebycheff(f, w / w.sum())[front]))]

"""How far the model is from an effect-free reality anyway: a floor under every misfit (rule 2).

Notation (P effect-free pairs of data set and model; K summaries of both tests)
    z       misfits of the cells after re-calibration
    u       means of z over the conditions of one material, by summary                   (K,) each
    A       covariance of u: what all conditions of a material share, coherent over summaries     (K, K)
    B       covariance of the part that is each condition's own, coherent over summaries too     (K, K)
    F       covariance of the cells: A between cells of one material, plus B within a condition     (N, N)

Coherent, because two codes differ in a law (how density falls with friction, say), and that moves many summaries
at once, just as an effect does. Estimated from data sets without an effect, by an independent code or a reference
material, each re-calibrated: moments of z less what noise, emulator and refit explain. The same floor goes into
the null runs.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.domain.data_set.columns import TESTS
from worker.diagnosis.measured import Frame
from worker.diagnosis.simulator import FloatArray
from worker.diagnosis.summaries import NAMES

KEYS = tuple((test, name) for test in TESTS for name in NAMES[test])
_PLACE = {key: k for k, key in enumerate(KEYS)}


class Misfits(NamedTuple):
    """Of one effect-free data set after re-calibration: z (N,), and the covariance that noise, emulator and the
    refit explain (N, N)."""

    frame: Frame
    z: FloatArray
    explained: FloatArray


@dataclass(frozen=True)
class Floor:
    """A and B (K, K) in the order of KEYS; zero where a summary was never compared."""

    shared: FloatArray
    own: FloatArray

    def covariance(self, frame: Frame) -> FloatArray:
        """F of a frame."""
        keys, materials = _places(frame)
        condition = np.array(frame.condition)
        both = np.ix_(keys, keys)
        one_material = materials[:, None] == materials[None, :]
        one_condition = condition[:, None] == condition[None, :]
        return np.where(one_material, self.shared[both], 0.0) + np.where(one_condition, self.own[both], 0.0)


_NOTHING = np.zeros((len(KEYS), len(KEYS)))
NO_FLOOR = Floor(_NOTHING, _NOTHING)


def _places(frame: Frame) -> tuple[NDArray[np.intp], NDArray[np.str_]]:
    """Of each cell its place in KEYS and its material (N,)."""
    keys = [_PLACE[(frame.conditions[c].test, frame.summary(i))] for i, c in enumerate(frame.condition)]
    return np.array(keys), np.array([frame.conditions[c].material for c in frame.condition])


def estimate_floor(pairs: Iterable[Misfits]) -> Floor:
    """Moments over the data sets and their materials, cut to positive semi-definite A and B."""
    K = len(KEYS)
    shared, counted = np.zeros((K, K)), np.zeros((K, K))
    own, freedom = np.zeros((K, K)), np.zeros((K, K))
    share, seen_in = np.zeros((K, K)), np.zeros((K, K))
    for frame, z, explained in pairs:
        keys, materials = _places(frame)
        condition = np.array(frame.condition)
        for material in np.unique(materials):
            member = np.flatnonzero(materials == material)
            n = np.bincount(keys[member], minlength=K).astype(float)
            M = np.zeros((K, len(z)))
            M[keys[member], member] = 1.0 / n[keys[member]]
            u, both = M @ z, np.outer(n > 0.0, n > 0.0)
            shared += np.where(both, np.outer(u, u) - M @ explained @ M.T, 0.0)
            counted += both
            together = np.minimum(n[:, None], n[None, :])
            share += np.where(both, 1.0 / np.maximum(together, 1.0), 0.0)
            seen_in += both
            for c in np.unique(condition[member]):
                cells = member[condition[member] == c]
                own_part = np.eye(len(z))[cells] - M[keys[cells]]
                excess = np.outer(own_part @ z, own_part @ z) - own_part @ explained @ own_part.T
                own[np.ix_(keys[cells], keys[cells])] += excess
            freedom += np.maximum(together - 1.0, 0.0)
    B = _positive(own / np.maximum(freedom, 1.0))
    # A mean over n conditions holds a part 1/n of what is each condition's own; of one test only.
    A = shared / np.maximum(counted, 1.0) - B * share / np.maximum(seen_in, 1.0)
    return Floor(_positive(A), B)


def _positive(raw: FloatArray) -> FloatArray:
    """The nearest covariance without negative eigenvalues, in the scale of each summary."""
    scale = np.sqrt(np.maximum(np.diag(raw), 0.0))
    ratio = np.divide(raw, np.outer(scale, scale), out=np.zeros_like(raw), where=np.outer(scale, scale) > 0.0)
    values, vectors = np.linalg.eigh(np.clip(ratio, -1.0, 1.0))
    repaired = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return np.asarray(repaired * np.outer(scale, scale))

"""What these observations can say at all (rule 4): detection limits, silent effects, effects that look alike.

Notation (K directions of E effects, whitened by V, which has re-calibration in it)
    |F|     length of a direction per unit of amplitude                                (K,)
    limit   4 / |F|: the amplitude that shows at 4 sigma; the worst sign or azimuth counts
    cosine  F_a . F_b / (|F_a| |F_b|), the best of the signs

Silent: the limit lies beyond the effect's physical range. Alike: cosine of .9 or more between all of a set.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from service.domain.effects import Library
from worker.diagnosis.ranking import Evidence
from worker.diagnosis.result import Limit
from worker.diagnosis.simulator import FloatArray

SIGMAS = 4.0
ALIKE_FROM = 0.9


@dataclass(frozen=True)
class Power:
    """By effect: `limits`, the silent ones, sets that look alike, and the cosines (E, E)."""

    limits: tuple[Limit, ...]
    not_testable: tuple[str, ...]
    indistinguishable: tuple[tuple[str, ...], ...]
    cosines: FloatArray


def power(evidence: Evidence) -> Power:
    """Before any verdict: it depends on the design, the noise and the parameters, hardly on what was measured."""
    known, directions = evidence.known, evidence.directions
    length = np.linalg.norm(evidence.F, axis=1)
    limits, silent = [], []
    for k, effect in enumerate(known.effects):
        shortest = float(np.min(length[directions.effect == k]))
        limit = SIGMAS / shortest if shortest > 0.0 else np.inf
        if limit > max(effect.highest, -effect.lowest):
            silent.append(effect.id)
        else:
            limits.append(Limit(effect.id, limit, effect.unit))
    cosines = _cosines(evidence, length)
    heard = [k for k, effect in enumerate(known.effects) if effect.id not in silent]
    return Power(tuple(limits), tuple(silent), _alike(known, heard, cosines), cosines)


def _cosines(evidence: Evidence, length: FloatArray) -> FloatArray:
    count = len(evidence.known.effects)
    unit = evidence.F / np.maximum(length, 1e-300)[:, None]
    table = unit @ unit.T
    owner = evidence.directions.effect
    found = np.eye(count)
    for a in range(count):
        for b in range(a):
            found[a, b] = found[b, a] = float(np.max(table[np.ix_(owner == a, owner == b)]))
    return found


def _alike(known: Library, heard: list[int], cosines: FloatArray) -> tuple[tuple[str, ...], ...]:
    """Greedy sets in which every two are alike."""
    found: list[list[int]] = []
    for k in heard:
        home = next((s for s in found if all(cosines[k, j] >= ALIKE_FROM for j in s)), None)
        if home is None:
            found.append([k])
        else:
            home.append(k)
    return tuple(tuple(known.effects[k].id for k in s) for s in found if len(s) > 1)

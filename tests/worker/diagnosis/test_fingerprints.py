"""Refined fingerprints: of runs that there were, never of those that gave nothing."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from worker.diagnosis.fingerprints import REFINED_SEEDS, Fingerprints, refine

SCREENED = np.array([[3.0, 0.0], [5.0, 5.0]])


class Prober:
    """Two cells: the baseline is 1; an effect adds ten times its size, and beyond .5 there is no pile."""

    def fresh(self) -> Prober:
        return self

    def means(self, _theta: Any, effects: dict[str, float], seeds: int, active: Any) -> Any:
        assert seeds == REFINED_SEEDS
        size = sum(effects.values())
        return np.where(active, 1.0 + 10.0 * size if size <= 0.5 else np.nan, 0.0)


@pytest.mark.parametrize(
    ("size", "expected"), [(0.2, [10.0, 0.0]), (0.7, [3.0, 0.0])], ids=["piles", "no piles"]
)
def test_a_fingerprint_without_runs_stays_as_it_was_screened(size: float, expected: list[float]) -> None:
    active = np.array([[True, False], [True, True]])
    prints = Fingerprints(("near", "other"), SCREENED.copy(), np.array([0.1, 0.2]), active)
    model: Any = SimpleNamespace(frame=SimpleNamespace(size=2), run_covariance=1e-8 * np.eye(2))
    prober: Any = Prober()
    found = refine(prints, prober, model, np.zeros(1), {"near": size})
    np.testing.assert_allclose(found.f, [expected, SCREENED[1]], rtol=1e-6)
    weight = 2.0 / REFINED_SEEDS / size**2 if size <= 0.5 else 0.1
    np.testing.assert_allclose(found.weight, [weight, 0.2])

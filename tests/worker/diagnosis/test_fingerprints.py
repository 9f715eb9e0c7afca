"""Fingerprints: of runs that made piles, never of those that gave nothing."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from worker.diagnosis.fingerprints import REFINED_SEEDS, Fingerprints, probe, refine

SCREENED = np.array([[3.0, 0.0], [5.0, 5.0]])


class Prober:
    """Two cells: the baseline is 1; an effect adds ten times its size, and beyond .5 there is no pile."""

    def fresh(self) -> Prober:
        return self

    def means(self, _theta: Any, effects: dict[str, float], seeds: int, active: Any) -> Any:
        assert seeds == REFINED_SEEDS
        size = sum(effects.values())
        return np.where(active, 1.0 + 10.0 * size if size <= 0.5 else np.nan, 0.0)


ACTIVE = np.array([[True, False], [True, True]])
MODEL: Any = SimpleNamespace(frame=SimpleNamespace(size=2), run_covariance=1e-8 * np.eye(2))


@pytest.mark.parametrize(("size", "probed"), [(0.2, 0.2), (0.7, 0.35), (3.9, 0.4875)])
def test_a_fingerprint_is_refined_at_the_first_half_that_makes_piles(size: float, probed: float) -> None:
    prints = Fingerprints(("near", "other"), SCREENED.copy(), np.array([0.1, 0.2]), ACTIVE)
    prober: Any = Prober()
    found = refine(prints, prober, MODEL, np.zeros(1), {"near": size})
    np.testing.assert_allclose(found.f, [[10.0, 0.0], SCREENED[1]], rtol=1e-6)
    np.testing.assert_allclose(found.weight, [2.0 / REFINED_SEEDS / probed**2, 0.2])


def test_a_fingerprint_without_piles_stays_as_it_was_screened() -> None:
    prints = Fingerprints(("near", "other"), SCREENED.copy(), np.array([0.1, 0.2]), ACTIVE)
    prober: Any = Prober()
    found = refine(prints, prober, MODEL, np.zeros(1), {"near": 9.0})
    np.testing.assert_allclose(found.f, SCREENED)
    np.testing.assert_allclose(found.weight, [0.1, 0.2])


def test_a_cell_that_no_run_gives_with_or_without_the_effect_does_not_halve_it() -> None:
    class Silent(Prober):
        def means(self, theta: Any, effects: dict[str, float], seeds: int, active: Any) -> Any:
            return np.where([True, False], super().means(theta, effects, seeds, active), np.nan)

    prober: Any = Silent()
    baseline = prober.means(np.zeros(1), {}, REFINED_SEEDS, ACTIVE[1])
    tried = probe(prober, np.zeros(1), {"other": 1.0}, 0.4, REFINED_SEEDS, ACTIVE[1], baseline)
    assert (tried.amplitude, tried.whole) == (0.4, True)

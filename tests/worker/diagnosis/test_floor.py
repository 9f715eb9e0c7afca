"""The floor is recovered from effect-free pairs whose discrepancy was drawn with known A and B."""

from __future__ import annotations

import numpy as np
import pytest

from service.domain.data_set.records import Condition
from worker.diagnosis.floor import KEYS, NO_FLOOR, Misfits, estimate_floor
from worker.diagnosis.measured import Frame
from worker.diagnosis.simulator import FloatArray
from worker.diagnosis.summaries import NAMES

ANGLE, APEX = (NAMES["pile"].index(name) for name in ("angle", "ln_apex"))
CONDITIONS = tuple(Condition(f"p{k}", "pile", "coke" if k < 6 else "sinter", 100.0) for k in range(10))
FRAME = Frame(
    CONDITIONS,
    tuple(c for c in range(10) for _ in range(2)),
    tuple(k for _ in range(10) for k in (ANGLE, APEX)),
)
SHARED = np.array([[0.04, 0.03], [0.03, 0.09]])
OWN = np.array([[0.02, -0.01], [-0.01, 0.02]])
NOISE = 0.05


def pairs(count: int) -> list[Misfits]:
    stream = np.random.default_rng(5)
    found = []
    for _ in range(count):
        common = {m: stream.multivariate_normal([0, 0], SHARED) for m in ("coke", "sinter")}
        z = [common[c.material] + stream.multivariate_normal([0, 0], OWN) for c in CONDITIONS]
        noise = np.sqrt(NOISE) * stream.standard_normal(20)
        found.append(Misfits(FRAME, np.concatenate(z) + noise, NOISE * np.eye(20)))
    return found


def part(table: FloatArray) -> FloatArray:
    places = [KEYS.index(("pile", name)) for name in ("angle", "ln_apex")]
    return table[np.ix_(places, places)]


def test_both_parts_are_recovered() -> None:
    floor = estimate_floor(pairs(400))
    assert part(floor.shared) == pytest.approx(SHARED, abs=0.015)
    assert part(floor.own) == pytest.approx(OWN, abs=0.006)


def test_covariance_of_the_cells() -> None:
    floor = estimate_floor(pairs(400))
    F = floor.covariance(FRAME)
    assert F[0, 0] == pytest.approx(0.06, abs=0.02)  # the same cell
    assert F[0, 2] == pytest.approx(0.04, abs=0.015)  # the same summary, another condition of the material
    assert F[0, 3] == pytest.approx(0.03, abs=0.015)  # another summary there
    assert F[0, 12] == 0.0  # another material
    assert np.min(np.linalg.eigvalsh(F)) > -1e-9


def test_noise_alone_leaves_next_to_no_floor() -> None:
    stream = np.random.default_rng(6)
    quiet = [
        Misfits(FRAME, np.sqrt(NOISE) * stream.standard_normal(20), NOISE * np.eye(20)) for _ in range(400)
    ]
    floor = estimate_floor(quiet)
    assert np.max(np.abs(part(floor.own))) < 0.006 and np.max(np.abs(part(floor.shared))) < 0.004


def test_no_floor_is_zero() -> None:
    assert not NO_FLOOR.covariance(FRAME).any()

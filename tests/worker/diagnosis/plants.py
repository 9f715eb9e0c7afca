"""Small data sets measured on the stand-in itself, so that what is hidden is known to the bit."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np

from service.domain.data_set.records import Condition, DataSet, Observation
from worker.diagnosis.diagnose import Diagnosis, Options, diagnose
from worker.diagnosis.simulator import Setting
from worker.diagnosis.stand_in import StandIn

PILES = tuple(
    Condition(
        f"P{k}",
        "pile",
        "coke",
        mass,
        moisture_percent=moisture,
        removal=removal,
        drop_height_m=drop,
        cylinder_height_m=1.6,
        holdout=k >= 6,
    )
    for k, (mass, moisture, removal, drop) in enumerate(
        [
            (80.0, 0.0, "instant", 0.2),
            (150.0, 4.0, "lift", 0.2),
            (300.0, 0.0, "lift", 1.0),
            (200.0, 6.0, "instant", 0.2),
            (400.0, 0.0, "instant", 2.0),
            (600.0, 3.0, "lift", 0.3),
            (250.0, 5.0, "instant", 0.3),
            (500.0, 0.0, "lift", 0.5),
        ]
    )
)
CHARGES = (
    Condition("C0", "charge", "coke", 3000.0),
    Condition("C1", "charge", "coke", 6000.0, feed_rate_kg_s=80.0, belt_speed_m_s=2.1),
    Condition("C2", "charge", "coke", 4500.0, moisture_percent=4.0, holdout=True),
)
THETA = (0.45, 0.25, 0.5, 0.3)
QUICK = Options(first_wave=48, second_wave=40, plants=100, seed=3)


def measured(
    effects: Mapping[str, float], seed: int = 1, replicates: int = 4, piles_only: bool = False
) -> DataSet:
    """Replicates of the stand-in with effects, which scatter as its runs do."""
    return measured_of(PILES if piles_only else (*PILES, *CHARGES), effects, seed, replicates)


def measured_of(
    conditions: tuple[Condition, ...], effects: Mapping[str, float], seed: int = 1, replicates: int = 4
) -> DataSet:
    """The same of any conditions."""
    observations = []
    for c in conditions:
        settings = [Setting(THETA, tuple(effects.items()), 1000 * seed + k) for k in range(replicates)]
        for name, values in StandIn().run(c, settings).values.items():
            observations += [Observation(c.condition, f"r{k}", name, float(v)) for k, v in enumerate(values)]
    return DataSet(conditions, tuple(observations))


@cache
def diagnosed(effect: str, amplitude: float) -> tuple[DataSet, Diagnosis]:
    """The diagnosis of a plant with one effect, made once for all tests."""
    data = measured({effect: amplitude} if amplitude else {})
    return data, diagnose(data, StandIn(), QUICK)


def normals(seed: int, *shape: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.random.default_rng(seed).standard_normal(shape)

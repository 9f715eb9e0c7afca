"""The noise model recovers what was put in: sds pooled, correlations, outliers, missing cells, stated sensors."""

from __future__ import annotations

import numpy as np
import pytest

from service.domain.data_set.records import Condition, DataSet, Observation, Profile
from tests.worker.diagnosis.plants import normals
from worker.diagnosis.measured import measure, replicate_tables, stated_sd
from worker.diagnosis.simulator import FloatArray
from worker.diagnosis.summaries import NAMES

M = len(NAMES["pile"])
ANGLE, APEX = NAMES["pile"].index("angle"), NAMES["pile"].index("ln_apex")


def tables(count: int, replicates: int, sd: float = 0.5, correlation: float = 0.6) -> dict[str, FloatArray]:
    """Angles of sd `sd` and apexes of sd .02 that are correlated; nothing else was seen."""
    found = {}
    for c in range(count):
        z = normals(100 + c, replicates, 2)
        x = np.full((replicates, M), np.nan)
        x[:, ANGLE] = 30.0 + c + sd * z[:, 0]
        x[:, APEX] = 0.02 * (correlation * z[:, 0] + np.sqrt(1.0 - correlation**2) * z[:, 1])
        found[f"p{c}"] = x
    return found


def conditions(count: int) -> list[Condition]:
    return [Condition(f"p{c}", "pile", "coke", 100.0 + c) for c in range(count)]


def test_the_pooled_sd_and_correlation_are_recovered() -> None:
    found = measure(conditions(60), tables(60, 6))
    known = found.scatter["pile"]
    # 300 degrees of freedom: an sd is known to 4 %; winsorising takes off 1 %.
    assert known.sd[ANGLE] == pytest.approx(0.5, rel=0.1)
    assert known.sd[APEX] == pytest.approx(0.02, rel=0.1)
    assert known.correlation[ANGLE, APEX] == pytest.approx(0.6, abs=0.12)
    assert known.freedom[ANGLE] == 300
    assert found.frame.size == 120 and found.S[0, 0] == pytest.approx(0.25 / 6.0, rel=0.35)
    assert found.S[0, 3] == 0.0  # another condition


def test_standardised_means_have_unit_variance() -> None:
    """Means of 200 conditions about their true values, in units of the stated sd: chi-square with 200."""
    found = measure(conditions(200), tables(200, 4))
    cells = [i for i in range(found.frame.size) if found.frame.summary(i) == "angle"]
    z = [(found.y[i] - 30.0 - found.frame.condition[i]) / np.sqrt(found.S[i, i]) for i in cells]
    assert np.mean(np.square(z)) == pytest.approx(1.0, abs=0.3)


def test_an_outlier_is_pulled_in() -> None:
    given = tables(20, 5)
    given["p3"][2, ANGLE] += 40.0
    found = measure(conditions(20), given)
    cell = next(i for i in range(found.frame.size) if found.frame.condition[i] == 3)
    assert abs(found.y[cell] - 33.0) < 1.5
    assert found.scatter["pile"].sd[ANGLE] < 0.8


def test_missing_replicates_count_less() -> None:
    given = tables(20, 5)
    given["p0"][1:4, ANGLE] = np.nan
    found = measure(conditions(20), given)
    assert found.runs[0] == 2 and found.S[0, 0] > 1.5 * found.S[2, 2]


def test_a_summary_without_scatter_is_left_out() -> None:
    given = tables(5, 4)
    for x in given.values():
        x[:, APEX] = 0.3
    found = measure(conditions(5), given)
    assert {found.frame.summary(i) for i in range(found.frame.size)} == {"angle"}


def test_a_sensor_is_never_better_than_it_says() -> None:
    given = tables(10, 4, sd=0.01)
    stated = {name: np.where(np.arange(M) == ANGLE, 0.8, 0.0) for name in given}
    found = measure(conditions(10), given, stated)
    assert found.run_sd[0] == pytest.approx(0.8, rel=0.3) and found.run_sd[0] >= 0.8


def test_without_pooling_each_condition_has_its_own_scatter() -> None:
    given = tables(10, 5)
    given["p0"][:, ANGLE] = 30.0 + 5.0 * normals(1, 5)
    pooled, alone = measure(conditions(10), given), measure(conditions(10), given, pooled=False)
    assert alone.S[0, 0] > pooled.S[0, 0] and alone.S[0, 1] == 0.0


def test_tables_and_stated_sds_come_from_the_records() -> None:
    pile = Condition("p", "pile", "coke", 100.0)
    data = DataSet(
        (pile,),
        (
            Observation("p", "a", "repose_angle_deg", 36.0, 0.2),
            Observation("p", "b", "apex_height_m", 0.5, 0.01),
        ),
        (Profile("p", "c", (0.0, 90.0), (0.1, 0.2), (0.3, 0.2)),),
    )
    table = replicate_tables(data)["p"]
    assert table.shape == (3, M) and table[0, ANGLE] == 36.0 and np.isnan(table[1, ANGLE])
    assert stated_sd(data)["p"][ANGLE] == 0.2
    assert stated_sd(data)["p"][APEX] == pytest.approx(0.02)

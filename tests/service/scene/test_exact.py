"""A grain's numbers and the table are those that are stored, not those that are drawn."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pytest

from service.scene.exact import ROWS_AT_ONCE, describe_grain, write_table
from service.scene.sphere_file import Spheres, read_spheres
from tests.builders.scenes import a_pile_file, a_series_file, block_of_grains


def test_a_grain_is_told_to_the_last_digit(tmp_path: Path) -> None:
    positions, radii = block_of_grains(60)
    told = describe_grain(read_spheres(a_pile_file(tmp_path, 60), 0), 17)
    assert [told[name] for name in ("x_m", "y_m", "z_m")] == positions[17].tolist()
    assert told["diameter_mm"] == pytest.approx(2000.0 * radii[17], rel=1e-12)
    assert told["speed_m_s"] == pytest.approx(0.017) and told["material"] == 1 and "number" not in told


def test_a_grain_of_a_series_has_its_number(tmp_path: Path) -> None:
    told = describe_grain(read_spheres(a_series_file(tmp_path), 3), 5)
    assert told["number"] == 105 and told["velocity_z_m_s"] == -0.25


@pytest.mark.parametrize("row", [-1, 60])
def test_there_is_no_grain_beyond_the_last(row: int, tmp_path: Path) -> None:
    with pytest.raises(IndexError):
        describe_grain(read_spheres(a_pile_file(tmp_path, 60), 0), row)


def test_what_is_not_finite_is_told_as_not_known() -> None:
    spheres = Spheres(0.0, np.array([[np.nan, 0.0, 0.0]]), np.array([0.01]), {})
    assert describe_grain(spheres, 0)["x_m"] is None
    assert list(write_table(spheres))[1] == ",0,0,20\r\n"


def test_the_table_has_every_grain_once(tmp_path: Path) -> None:
    count = ROWS_AT_ONCE + 3
    text = "".join(write_table(read_spheres(a_pile_file(tmp_path, count), 0)))
    rows = list(csv.DictReader(io.StringIO(text)))
    assert len(rows) == count
    assert float(rows[17]["x_m"]) == pytest.approx(block_of_grains(count)[0][17, 0], rel=1e-8)
    assert float(rows[-1]["speed_m_s"]) == pytest.approx(1e-3 * (count - 1))

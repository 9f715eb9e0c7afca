"""Reading a data set: every bad cell is named with its file, row and column, and right ones are converted."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from service.domain.data_set.cells import BadDataSet, parse_psd, unit_factor
from service.domain.data_set.columns import CHARGE_OBSERVABLES, PILE_OBSERVABLES
from service.domain.data_set.reading import data_set_from_json, data_set_from_tables, read_data_set
from service.domain.data_set.records import DataSet, Observation
from service.domain.data_set.suitability import suitability
from service.domain.data_set.tables import LARGEST_FILE_BYTES
from tests.service.domain.data_set.tables import CONDITIONS, OBSERVATIONS, tables

PROFILE = "condition,replicate,theta_deg,r_m,h_m\np1,0,0,0.1,0.30\np1,0,180,0.1,0.31\n"


def complaints(texts: dict[str, str]) -> list[tuple[str, int | None, str, str]]:
    with pytest.raises(BadDataSet) as caught:
        data_set_from_tables(texts)
    return [(cell.file, cell.row, cell.column, cell.value) for cell in caught.value.cells]


def test_empty_cells_are_defaults() -> None:
    data = data_set_from_tables(tables())
    dry, wet, charge = data.conditions
    assert (dry.moisture_percent, wet.moisture_percent, dry.removal) == (0.0, 4.0, "instant")
    assert dry.psd == ((0.02, 0.3), (0.05, 0.7)) and wet.psd is None
    assert [c.holdout for c in data.conditions] == [False, False, True]
    assert charge.belt_speed_m_s == 1.79
    assert {c.condition for c in data.held_out.conditions} == {"c1"}
    assert {o.condition for o in data.training.observations} == {"p1", "p2"}
    assert data.observations[0].sensor_sd == 0.1 and data.observations[-1].sensor_sd is None


def test_folder_and_json_hold_the_same(tmp_path: Path) -> None:
    for name, text in tables(profiles=PROFILE).items():
        (tmp_path / name).write_text("\ufeff" + text, encoding="utf-8")
    folder = read_data_set(tmp_path)
    rows = {}
    for name, text in tables(profiles=PROFILE).items():
        header, *lines = [line.split(",") for line in text.splitlines()]
        cells = [dict(zip(header, line, strict=True)) for line in lines]
        rows[name.removesuffix(".csv")] = [{k: (v or None) for k, v in row.items()} for row in cells]
    file = tmp_path / "one.json"
    file.write_text(json.dumps(rows))
    assert read_data_set(file) == folder
    assert folder.profiles[0].h_m == (0.30, 0.31)


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [("620", "mm", 0.620), ("62", "cm", 0.620), ("0.62", "m", 0.62), ("24.409448818897637", "inch", 0.62)],
)
def test_units_of_the_same_kind_are_converted(value: str, unit: str, expected: float) -> None:
    text = OBSERVATIONS + f"p1,0,apex_height_m,{value},{unit},\n"
    found = data_set_from_tables(tables(observations=text)).observations[-1]
    assert found.value == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    "unit",
    ["", "kg", "deg", "degC", "m/s", "banana", "m**", "1/0", "(" * 300, "2 m", "-m", "m**9**9**9", "m^99"],
)
def test_a_unit_of_another_kind_is_refused(unit: str) -> None:
    assert unit_factor(unit or "none", "m") is None


@pytest.mark.parametrize(
    ("unit", "wanted", "factor"),
    [
        ("kg/m3", "kg/m^3", 1.0),
        ("kg/m^3", "kg/m**3", 1.0),
        ("kg/m**3", "kg/m^3", 1.0),
        ("kg/m³", "kg/m^3", 1.0),
        ("kg m-3", "kg/m^3", 1.0),
        ("g/cm3", "kg/m^3", 1000.0),
        ("m2", "m^2", 1.0),
        ("cm2", "m^2", 1e-4),
        ("m3", "m**3", 1.0),
        ("percent", "", 0.01),
        ("°", "deg", 1.0),
        ("degrees", "deg", 1.0),
        ("mrad", "deg", 0.05729577951308232),
    ],
)
def test_powers_and_degrees_are_written_in_many_ways(unit: str, wanted: str, factor: float) -> None:
    assert unit_factor(unit, wanted) == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize(
    "unit", ["%", "percent", "count", "ppm", "m/m", "dimensionless", "turn", "rad/m*m", "deg2"]
)
def test_an_angle_is_in_degrees_or_radians(unit: str) -> None:
    """71 % is the tangent of 35.4 deg, and was read as 40.68 deg."""
    with pytest.raises(BadDataSet) as caught:
        data_set_from_tables(tables(observations=OBSERVATIONS + f"p1,9,repose_angle_deg,71,{unit},\n"))
    (cell,) = caught.value.cells
    assert (cell.column, cell.value) == ("unit", unit)
    assert cell.allowed == "deg, degree, degrees, °, rad, radian, radians or mrad"


def test_density_units_convert() -> None:
    assert unit_factor("t/m^3", "kg/m^3") == pytest.approx(1000.0)
    assert unit_factor("rad", "deg") == pytest.approx(57.29577951308232)
    assert unit_factor("min", "s") == pytest.approx(60.0)


@pytest.mark.parametrize(
    ("row", "column"),
    [
        ("p1,9,repose_angle_deg,nan,deg,", "value"),
        ("p1,9,repose_angle_deg,inf,deg,", "value"),
        ("p1,9,repose_angle_deg,-3,deg,", "value"),
        ("p1,9,repose_angle_deg,0,deg,", "value"),
        ("p1,9,repose_angle_deg,95,deg,", "value"),
        ("p1,9,repose_angle_deg,36_5,deg,", "value"),
        ("p1,9,repose_angle_deg,steep,deg,", "value"),
        ("p1,9,repose_angle_deg,36,kg,", "unit"),
        ("p1,9,repose_angle_deg,36,,", "unit"),
        ("p1,9,repose_angle_deg,36,deg,-1", "sensor_sd"),
        ("p1,9,repose_angle_deg,36,deg,nan", "sensor_sd"),
        ("p1,9,belt_depth_m,0.1,m,", "observable"),
        ("p1,9,angle,36,deg,", "observable"),
        ("nowhere,9,repose_angle_deg,36,deg,", "condition"),
        ("p1,,repose_angle_deg,36,deg,", "replicate"),
        ("p1,../x,repose_angle_deg,36,deg,", "replicate"),
        ("p1,0,repose_angle_deg,33,deg,", "observable"),
    ],
)
def test_a_bad_observation_is_named(row: str, column: str) -> None:
    last = OBSERVATIONS.count("\n") + 1
    assert [c[:3] for c in complaints(tables(observations=OBSERVATIONS + row + "\n"))] == [
        ("observations.csv", last, column)
    ]


@pytest.mark.parametrize(
    ("row", "column"),
    [
        ("p1,pile,coke,5,,,", "condition"),
        ("p9,heap,coke,5,,,", "test"),
        ("p9,pile,,5,,,", "material"),
        ("p9,pile,coke,,,,", "mass_kg"),
        ("p9,pile,coke,-5,,,", "mass_kg"),
        ("p9,pile,coke,0,,,", "mass_kg"),
        ("p9,pile,coke,5,wet,,", "moisture_percent"),
        ("p9,pile,coke,5,400,,", "moisture_percent"),
        ("p9,pile,coke,5,,0.02:0.3;0.05:0.3,", "psd"),
        ("p9,pile,coke,5,,0.02:0.5;0.02:0.5,", "psd"),
        ("p9,pile,coke,5,,20 mm,", "psd"),
        ("p9,pile,coke,5,,,maybe", "holdout"),
    ],
)
def test_a_bad_condition_is_named(row: str, column: str) -> None:
    found = complaints(tables(conditions=CONDITIONS + row + "\n"))
    assert [c[:3] for c in found] == [("conditions.csv", 5, column)]


@pytest.mark.parametrize(
    ("test", "cells", "why"),
    [
        ("pile", {"lift_speed_m_s": "0.4"}, "write `lift` as removal"),
        ("pile", {"lift_speed_m_s": "0.4", "removal": "instant"}, "write `lift` as removal"),
        ("pile", {"belt_speed_m_s": "1.5"}, "no such thing"),
        ("pile", {"deflector_rotation_deg": "5"}, "no such thing"),
        ("charge", {"removal": "lift"}, "no such thing"),
        ("charge", {"cylinder_height_m": "1.6"}, "no such thing"),
    ],
)
def test_a_cell_that_does_not_apply_is_told(test: str, cells: dict[str, str], why: str) -> None:
    """It is not refused: a program may write out more columns than a test has."""
    head = ",".join(["condition,test,material,mass_kg", *cells])
    texts = {"conditions.csv": head + "\n" + ",".join(["a", test, "coke", "100", *cells.values()]) + "\n"}
    data = data_set_from_tables(texts, planned=True)
    column = next(iter(cells))
    assert data.conditions[0].ignored == (column,)
    pile = replace(data.conditions[0], condition="b", test="pile", removal="lift")
    observed = tuple(Observation("b", f"r{k}", "apex_height_m", 0.1 + k) for k in range(3))
    told = suitability(DataSet((*data.conditions, pile), observed)).sentences
    assert [s for s in told if s.startswith(f"Not used: {column} of a") and why in s]


def test_a_lifted_cylinder_has_a_speed_and_a_charge_a_belt() -> None:
    texts = """condition,test,material,mass_kg,removal,lift_speed_m_s,belt_speed_m_s
a,pile,coke,100,lift,0.4,
b,charge,coke,3000,,,1.5
"""
    pile, charge = data_set_from_tables({"conditions.csv": texts}, planned=True).conditions
    assert (pile.lift_speed_m_s, charge.belt_speed_m_s) == (0.4, 1.5)


def test_of_a_record_written_with_all_of_its_defaults_nothing_is_told() -> None:
    head = "condition,test,material,mass_kg,removal,lift_speed_m_s,belt_speed_m_s,deflector_rotation_deg"
    rows = "a,pile,coke,100,instant,0.1,1.79,0\nb,charge,coke,3000,instant,0.1,1.79,0.0\n"
    found = data_set_from_tables({"conditions.csv": f"{head}\n{rows}"}, planned=True).conditions
    assert [c.ignored for c in found] == [(), ()]


def test_every_bad_cell_is_named_at_once() -> None:
    conditions = CONDITIONS.replace("p2,pile,coke,200", "p2,pile,coke,heavy")
    observations = (
        OBSERVATIONS.replace("35.8,deg", "35.8,kg").replace("34.8", "x").replace("0.126,m", "0.126,s")
    )
    found = complaints(tables(conditions=conditions, observations=observations))
    assert [(file, row, column) for file, row, column, _ in found] == [
        ("conditions.csv", 3, "mass_kg"),
        ("observations.csv", 3, "unit"),
        ("observations.csv", 9, "unit"),
    ]


@pytest.mark.parametrize(
    ("conditions", "row", "column"),
    [
        (CONDITIONS.replace("moisture_percent", "moisture"), 1, "moisture"),
        (CONDITIONS.replace("mass_kg", "test"), 1, "test"),
        (CONDITIONS.replace("material", "psd", 1), 1, "psd"),
        (CONDITIONS + "p9,pile\n", 5, ""),
        ("", 1, ""),
        (CONDITIONS.splitlines()[0] + "\n", None, ""),
        (CONDITIONS.replace(",", ";"), 1, None),
        (CONDITIONS + '"p9,pile\n', 5, ""),
    ],
)
def test_a_table_of_a_wrong_shape_is_named(conditions: str, row: int | None, column: str | None) -> None:
    file, at, where, _ = complaints(tables(conditions=conditions))[0]
    assert (file, at) == ("conditions.csv", row)
    assert column is None or where == column


def test_a_wrong_header_is_not_told_again_by_each_row_that_names_a_condition() -> None:
    found = complaints(tables(conditions=CONDITIONS.replace("mass_kg", "mass")))
    assert [c[:3] for c in found] == [("conditions.csv", 1, "mass"), ("conditions.csv", 1, "mass_kg")]


def test_missing_cells_are_normal() -> None:
    text = OBSERVATIONS.replace("36.9", "")
    assert len(data_set_from_tables(tables(observations=text)).observations) == 8


def test_profile_points_are_checked() -> None:
    bad = PROFILE + "p1,0,0,0.1,0.4\np1,1,0,-1,0.3\nzz,1,0,0.1,nan\n"
    assert [c[:3] for c in complaints(tables(profiles=bad))] == [
        ("profiles.csv", 4, "theta_deg, r_m"),
        ("profiles.csv", 5, "r_m"),
        ("profiles.csv", 6, "condition"),
        ("profiles.csv", 6, "h_m"),
    ]


def test_a_replicate_that_is_a_copy_is_named() -> None:
    masses = {"p1": ("48.2134", "47.8821", "48.5518"), "p2": ("81.0237", "80.4419", "81.5526")}
    rows = OBSERVATIONS + "".join(
        f"{name},{k},mass_on_base_kg,{mass},kg,\n"
        for name, found in masses.items()
        for k, mass in enumerate(found)
    )
    rows += "p1,3,mass_on_base_kg,48213.4,g,\np1,3,repose_angle_deg,36.2,deg,\n"
    with pytest.raises(BadDataSet) as caught:
        data_set_from_tables(tables(observations=rows))
    assert str(caught.value) == (
        "observations.csv row 17, replicate: got '3', "
        "allowed is an experiment of its own; it repeats replicate 0 of p1"
    )


def test_a_surface_that_is_a_copy_is_named() -> None:
    """Three replicates under three names, with one scan."""
    heights = [0.3 - 0.004 * k + 0.0137 * (k * k % 7) for k in range(40)]
    rows = [f"p1,{i},{9 * k},0.1,{h:.4f}" for i in range(3) for k, h in enumerate(heights)]
    found = complaints(tables(profiles="\n".join(["condition,replicate,theta_deg,r_m,h_m", *rows]) + "\n"))
    assert found == [("profiles.csv", 42, "replicate", "1"), ("profiles.csv", 82, "replicate", "2")]


def test_rounded_numbers_that_meet_by_chance_are_no_copy() -> None:
    rows = OBSERVATIONS + "p1,3,repose_angle_deg,36.2,deg,\n"
    assert len(data_set_from_tables(tables(observations=rows)).observations) == 10


def test_files_that_are_no_tables(tmp_path: Path) -> None:
    (tmp_path / "conditions.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BadDataSet, match=r"conditions.csv.*UTF-8"):
        read_data_set(tmp_path)
    with pytest.raises(BadDataSet, match="no such file"):
        read_data_set(tmp_path / "none")
    with (tmp_path / "conditions.csv").open("wb") as file:
        file.truncate(LARGEST_FILE_BYTES + 1)
    with pytest.raises(BadDataSet, match="at most"):
        read_data_set(tmp_path)


@pytest.mark.parametrize("text", ["", "[]", "{", '{"conditions": 3}', '{"plans": []}', "[" * 5000])
def test_json_that_is_no_data_set(text: str) -> None:
    with pytest.raises(BadDataSet):
        data_set_from_json(text)


def test_psd_is_sorted_and_normalised() -> None:
    assert parse_psd(" 0.05:0.503 ;0.02:0.5;") == (
        (0.02, pytest.approx(0.5 / 1.003)),
        (0.05, pytest.approx(0.503 / 1.003)),
    )


def test_observables_are_those_of_the_design() -> None:
    assert len(PILE_OBSERVABLES) == 8
    assert len(CHARGE_OBSERVABLES) == 2 * 24 + 8
    assert {"sector_height_m_01", "sector_mass_kg_24", "discharge_t100_s"} <= set(CHARGE_OBSERVABLES)


def test_the_format_imports_nothing_of_the_rest() -> None:
    """So that who hides an effect can share it with who finds it: neither worker nor demcore comes along."""
    code = (
        "import sys, service.domain.data_set.reading, service.domain.data_set.suitability;"
        "print([m for m in sys.modules if m.split('.')[0] in ('worker', 'demcore', 'numpy', 'sqlalchemy')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"

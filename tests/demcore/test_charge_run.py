"""The charge as a program: a few seconds of coke at a coarse scale; a resumed run is the same to the last bit."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from demcore.errors import Cancelled, NoResult
from demcore.experiments import charge_case
from demcore.experiments.charge_case import ChargeTest, load_charge
from demcore.experiments.charge_drawing import draw_all
from demcore.experiments.charge_file import write_charge
from demcore.experiments.charge_run import BELT, HOPPER
from demcore.experiments.charge_test import run_charge
from demcore.output.result_file import read_result
from demcore.plant.plant_file import load_plant

SHORT = ChargeTest(replace(load_charge("coke"), duration=1.5), load_plant(), scale=8.0, rest_seconds=3.5)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """The short charge, stopped once on its way and taken up again."""
    path = tmp_path_factory.mktemp("charge") / "run.checkpoint"
    with pytest.raises(Cancelled):
        run_charge(SHORT, lambda p: p.time_s < 3.0, checkpoint_path=path)
    return run_charge(SHORT, checkpoint_path=path)


def test_all_mass_is_somewhere_at_every_report(result):
    assert len(result.accounts) == pytest.approx(10 * result.accounts[-1].time, abs=2)
    for account in result.accounts:
        assert account.missing == pytest.approx(0.0, abs=1e-9)
        assert min(account.on_belt, account.in_flight, account.in_hopper, account.lost) >= 0.0
    kinds = np.array([[a.on_belt, a.in_flight, a.in_hopper] for a in result.accounts]) > 0.0
    assert kinds.any(axis=0).all()


def test_the_charge_came_to_one_grain_and_lies_in_the_hopper(result):
    largest = result.masses.max()
    assert result.numbers["fed_kg"] == pytest.approx(150.0 / 3.6 * 1.5, abs=largest)
    assert result.numbers["in_hopper_kg"] > 0.9 * result.numbers["fed_kg"]
    assert (result.places == HOPPER).sum() == result.numbers["particles_in_hopper"]
    assert not (result.places == BELT).any()


def test_the_burden_is_measured(result):
    s = result.summary()
    assert sum(s["sectors"]["mass"]) == pytest.approx(s["in_hopper_kg"])
    assert 0.0 <= s["far_share_of_mass"] <= 1.0
    assert s["volume_m3"] > 0.0
    ridge = load_plant().deflector.ridge_across
    split = np.interp(ridge, s["jet"]["ridge_at_m"], s["jet"]["far_of_that_ridge"])
    assert split == pytest.approx(s["jet"]["far_of_ridge"], abs=0.1)
    assert s["walls"]["bell"]["load_N"] + s["walls"]["hopper cone"]["load_N"] > 0.5 * 9.81 * s["in_hopper_kg"]
    assert s["walls"]["deflector"]["strikes"] > 0
    # What fell some two metres brought that energy, most of it to the deflector.
    drop = 9.81 * 2.4 * s["fed_kg"]
    assert 0.1 * drop < sum(wall["energy_J"] for wall in s["walls"].values()) < 2.0 * drop
    json.dumps(result.findings())


def test_a_charge_that_was_stopped_and_taken_up_is_the_same_to_the_last_bit(result):
    whole = run_charge(SHORT)
    assert (whole.positions == result.positions).all()
    assert (whole.velocities == result.velocities).all()
    assert whole.accounts[-1] == result.accounts[-1]
    assert (whole.section.mass == result.section.mass).all()
    assert (whole.jet.mass == result.jet.mass).all()
    assert whole.wear.cells == result.wear.cells


def test_the_files_hold_what_was_found(result, tmp_path):
    path = tmp_path / "charge.vtkhdf"
    write_charge(result, path)
    stored = read_result(path)
    assert stored.kind == "charge"
    assert (stored.columns["particles/position"].values == result.positions).all()
    assert stored.summary["in_hopper_kg"] == result.numbers["in_hopper_kg"]
    assert stored.case["plant"]["sources"]["belt.speed_m_s"] == "paper, section 3.1"
    assert len(stored.columns["account/fed"].values) == len(result.accounts)
    again = tmp_path / "again.vtkhdf"
    write_charge(result, again)
    assert path.read_bytes() == again.read_bytes()


def test_the_pictures_show_the_burden(result, tmp_path):
    draw_all(result, tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {
        "burden.png",
        "charge.png",
        "curves.png",
        "wear.png",
    }
    for file in tmp_path.iterdir():
        colours = np.unique(np.array(Image.open(file)).reshape(-1, 3), axis=0)
        assert len(colours) > 50


def test_an_inlet_that_cannot_pass_the_rate_gives_no_result(monkeypatch):
    monkeypatch.setattr(charge_case, "LONGEST_LAG", 0.1)
    flood = replace(SHORT.charge, rate=3000.0, duration=0.3)
    test = replace(SHORT, charge=flood, rest_seconds=0.1)
    with pytest.raises(NoResult, match="the inlet passed only"):
        run_charge(test)

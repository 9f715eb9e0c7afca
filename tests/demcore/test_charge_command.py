"""python -m demcore charge: bad input is one line and leaves nothing; the plant is drawn, the cost told."""

from __future__ import annotations

import pytest
from PIL import Image

from demcore.__main__ import main
from demcore.commands.charge import mass_lines
from demcore.experiments import charge_test
from demcore.experiments.charge_cost import Rate


def refused(arguments, capsys):
    """What a refused command says: one line on stderr, nothing on stdout."""
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("error: ")
    assert captured.err.count("\n") == 1
    return captured.err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["granite"], "charge: got 'granite', allowed is one of coke, iron"),
        (["coke", "--scale", "0"], "scale: got 0.0"),
        (["coke", "--scale", "nan"], "scale"),
        (["coke", "--seed", "-1"], "seed"),
        (["coke", "--feed", "12"], "feed: got '12', allowed is a positive number with its unit"),
        (["coke", "--rest", "10"], "rest: got '10', allowed is a positive number with its unit"),
        (["coke", "--frames", "0s"], "frames"),
        (["coke", "--threads", "0"], "threads"),
        (["coke", "--checkpoint-seconds", "-1"], "checkpoint_seconds"),
        (["coke", "--plant", "nowhere.toml"], "plant_file"),
        (["coke", "--fly"], "unrecognized arguments"),
        ([], "required"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(arguments, said, tmp_path, capsys):
    assert said in refused(["charge", *arguments, "--out", str(tmp_path / "a" / "b")], capsys)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("plant", "said"),
    [
        ("[belt]\nspeed_m_s = 4.0\n", "belt.speed: got 4.0, allowed is a jet through the hatch"),
        ("[hopper]\nrim_radius_mm = 1.6\n", "hopper.seat_radius"),
        ("[hopper]\nrim_radius_mm = 1650\ncylinder_height_mm = 1\nseat_depth_mm = 1450\n", "charge.mass"),
        ("[deflector]\nridge_height_mm = 900\n", "deflector"),
        ("[feeder]\ndrop_mm = 50\n", "feeder.drop"),
    ],
)
def test_a_plant_that_cannot_be_charged_is_one_line_and_leaves_nothing(plant, said, tmp_path, capsys):
    file = tmp_path / "mine.toml"
    file.write_text(plant)
    arguments = ["charge", "iron", "--plant", str(file), "--out", str(tmp_path / "out")]
    assert said in refused(arguments, capsys)
    assert list(tmp_path.iterdir()) == [file]


def test_the_plant_is_drawn_and_nothing_run(tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["charge", "coke", "--draw", "--out", str(out)]) == 0
    assert [file.name for file in out.iterdir()] == ["plant.png"]
    assert Image.open(out / "plant.png").size[0] > 1000
    assert str(out / "plant.png") in capsys.readouterr().out


def test_the_cost_is_told_and_nothing_written(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(charge_test, "measure_rate", lambda test: Rate(1e3, 1e-3, 600))
    assert main(["charge", "iron", "--scale", "1", "--estimate", "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    assert "THAT IS DAYS" in told
    assert list(tmp_path.iterdir()) == []


def test_what_is_told_at_the_end_adds_up():
    summary = {
        "fed_kg": 100.0,
        "on_belt_kg": 1.0,
        "in_flight_kg": 2.0,
        "in_hopper_kg": 95.0,
        "lost_kg": 2.0,
        "missing_kg": 0.0,
        "squeezed_through_walls": 3,
        "belt": {"rate_kg_s": 41.5, "set_rate_kg_s": 41.67, "stratification": 0.25},
        "jet": {"far_of_ridge": 0.625},
        "variation_of_mass": 0.3,
        "variation_of_height": 0.2,
        "variation_of_size": 0.1,
        "far_share_of_mass": 0.55,
        "segregation_intensity": 0.05,
        "segregation_of_a_random_mix": 0.03,
    }
    mass, belt, even = mass_lines(summary)
    assert "100.00 kg = belt 1.00 + flight 2.00 + hopper 95.00 + lost 2.00 kg" in mass
    assert "3 grains" in mass
    assert "41.50 kg/s of 41.67" in belt and "+0.25" in belt and "62% of the jet" in belt
    assert "55% lies on the far side" in even

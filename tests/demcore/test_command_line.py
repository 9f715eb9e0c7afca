"""python -m demcore: what it writes, and that bad input is one line, exit status 2, and nothing left behind."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import warnings

import numpy as np
import pytest
import pyvista
from PIL import Image

from demcore import checkpoint
from demcore.__main__ import main
from demcore.commands.progress_bar import duration
from demcore.commands.quantity import parse_quantity
from demcore.commands.warning_lines import checkpoint_warnings_as_lines
from demcore.errors import InputError
from demcore.output.result_file import read_result
from demcore.picture import BACKGROUND, STEEL, render_spheres
from demcore.verification import cases
from demcore.verification.impact import bounce_heights
from demcore.verification.outcome import Outcome
from tests.demcore.output.vtk_reading import read_steps

MATERIAL = """
[gravel]
bulk_density_kg_m3 = 1600.0
packing_fraction = 0.6
youngs_modulus_pa = 1.0e7
poisson_ratio = 0.25
long_term_damping = 0.5
dynamic_friction_ratio = 0.9
wall_restitution = [{ value = 0.3, mass_share = 1.0 }]
sizes = [{ lower_mm = 20.0, upper_mm = 40.0, mass_share = 1.0 }]
"""
OWN = ["gravel", "--rig", "pellet", "--scale", "1"]
OWN += ["--friction", ".5", "--wall-friction", ".5", "--restitution", ".3", "--rolling", ".1"]


def refused(arguments, capsys):
    """What a refused command says: one line on stderr, nothing on stdout."""
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("error: ")
    assert captured.err.count("\n") == 1
    return captured.err


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["pellet", "--scale", "50"], "scale"),
        (["pellet", "--scale", "0"], "scale"),
        (["pellet", "--scale", "nan"], "scale"),
        (["coke", "--scale", "7"], "scale: got 7.0, allowed is at most"),
        (["pellet", "--restitution", "1.4"], "particle_particle_restitution: got 1.4, allowed is 0.05 to 1"),
        (["pellet", "--rolling", "-1"], "rolling_resistance"),
        (["pellet", "--friction", "inf"], "particle_particle_static_friction"),
        (["pellet", "--fill-level", "2"], "fill_level"),
        (["pellet", "--time-step", "quick"], "time_step"),
        (
            ["pellet", "--time-step", "5e-5"],
            "time_step: got '5e-5', allowed is a positive number with its unit",
        ),
        (["pellet", "--time-step=-5us"], "time_step"),
        (["pellet", "--time-step", "1ms"], "time_step: got '1ms', allowed is at most"),
        (["pellet", "--lift", "30"], "lift: got '30', allowed is a positive number with its unit"),
        (["pellet", "--lift", "999m/s"], "lift_speed"),
        (["pellet", "--frames", "0s"], "frames"),
        (["pellet", "--frames", "1"], "frames"),
        (["pellet", "--seed", "-1"], "seed"),
        (["pellet", "--threads", "0"], "threads"),
        (["pellet", "--checkpoint-seconds", "-1"], "checkpoint_seconds"),
        (["granite"], "material: got 'granite', allowed is one of coke, sinter, pellet"),
        (["pellet", "--rig", "silo"], "rig"),
        (["pellet", "--parameter", "friction=.3"], "parameter: got 'friction=.3', allowed is NAME=VALUE"),
        (["pellet", "--parameter", "dynamic_friction_ratio=high"], "dynamic_friction_ratio with a number"),
        (["pellet", "--parameter", "dynamic_friction_ratio=2"], "dynamic_friction_ratio: got 2.0"),
        (["pellet", "--contact-model", "soft"], "contact_model"),
        (["pellet", "--pairs", "mean"], "material: got 'pellet', allowed is a mix"),
        (["sinter65_pellet35", "--pairs", "mean", "--rolling", "1"], "pairs"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(arguments, named, tmp_path, capsys):
    out = tmp_path / "a" / "b"
    assert named in refused(["pile", *arguments, "--out", str(out)], capsys)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("lower_mm = 20.0", "lower_mm = -20.0", "sizes.lower: got -0.02"),
        ("upper_mm = 40.0", "upper_mm = 10.0", "sizes.upper"),
        ("upper_mm = 40.0, mass_share = 1.0", "upper_mm = 40.0, mass_share = 0.0", "leave an empty"),
        ("upper_mm = 40.0, mass_share = 1.0", "upper_mm = 40.0, mass_share = 0.9", "shares that sum to 1"),
        ("[{ lower_mm = 20.0, upper_mm = 40.0, mass_share = 1.0 }]", "[]", "at least one size class"),
        ("lower_mm = 20.0", "lower = 0.02", "gravel.sizes[0].lower: got 0.02, allowed is lower_mm"),
        ("bulk_density_kg_m3 = 1600.0", "bulk_density = 1600.0", "allowed is bulk_density_kg_m3"),
        ("bulk_density_kg_m3 = 1600.0", "", "bulk_density_kg_m3: got None"),
        ("bulk_density_kg_m3 = 1600.0", "bulk_density_kg_m3 = '1600'", "a number"),
        ("bulk_density_kg_m3 = 1600.0", "bulk_density_kg_m3 = nan", "bulk_density"),
        ("bulk_density_kg_m3 = 1600.0", "bulk_density_kg_m3 = true", "a number"),
        ("value = 0.3", "value = 1.4", "wall_restitution.value: got 1.4"),
        ("packing_fraction", "colour = 'red'\npacking_fraction", "gravel.colour: got 'red'"),
        ("[gravel]", "[gravel", "a TOML file"),
        ("[gravel]", "[sand]", "one of sand in own.toml"),
        (
            "lower_mm = 20.0, upper_mm = 40.0",
            "lower_mm = 2000.0, upper_mm = 4000.0",
            "of the largest particles fit",
        ),
    ],
)
def test_a_bad_material_is_one_line_and_leaves_nothing(before, after, said, tmp_path, capsys):
    assert before in MATERIAL
    file = tmp_path / "own.toml"
    file.write_text(MATERIAL.replace(before, after, 1))
    told = refused(["pile", *OWN, "--material-file", str(file), "--out", str(tmp_path / "out")], capsys)
    assert said in told
    assert list(tmp_path.iterdir()) == [file]


def test_a_material_file_that_is_not_there_or_no_text_is_one_line(tmp_path, capsys):
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    for name in ("nowhere.toml", "binary.toml", "."):
        told = refused(["pile", *OWN, "--material-file", str(tmp_path / name)], capsys)
        assert told.startswith("error: material_file: got ")


def test_a_material_of_ones_own_needs_its_contact_values_and_a_rig(tmp_path, capsys):
    file = tmp_path / "own.toml"
    file.write_text(MATERIAL)
    chosen = ["pile", "gravel", "--material-file", str(file)]
    assert "by --rig" in refused(chosen, capsys)
    assert "error: friction: got None" in refused([*chosen, "--rig", "pellet"], capsys)


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["fly"],
        ["pile"],
        ["pile", "pellet", "--scale", "two"],
        ["pile", "pellet", "--seed", "1.5"],
        ["pile", "pellet", "--colour", "red"],
        ["bench", "--against", "yade"],
    ],
)
def test_what_argparse_refuses_is_one_line_too(arguments, capsys):
    refused(arguments, capsys)


def test_an_out_that_is_a_file_or_below_one_is_refused(tmp_path, capsys):
    (tmp_path / "file").write_text("mine")
    for out in (tmp_path / "file", tmp_path / "file" / "below"):
        told = refused(["pile", "pellet", "--out", str(out)], capsys)
        assert "is a file" in told
    assert (tmp_path / "file").read_text() == "mine"


def test_an_out_that_cannot_be_made_is_refused(capsys):
    # Nobody makes folders there, not even root.
    told = refused(["pile", "pellet", "--out", "/proc/demcore/out"], capsys)
    assert "error: out: got '/proc/demcore/out'" in told


@pytest.mark.parametrize(
    ("text", "seconds"), [("50us", 5e-5), ("0.05 s", 0.05), ("2e-1ms", 2e-4), (" 1.s ", 1.0), (".5s", 0.5)]
)
def test_a_quantity_is_read_with_its_unit(text, seconds):
    assert parse_quantity("time_step", text, "time") == pytest.approx(seconds, rel=1e-15)
    assert parse_quantity("lift", "30 mm/s", "speed") == pytest.approx(0.03)


@pytest.mark.parametrize(
    "text", ["", "s", "5", "5 kg", "5S", "nan s", "inf s", "-1s", "0s", "1e999s", "1s s", "0x1s"]
)
def test_a_quantity_without_number_or_unit_is_refused(text):
    with pytest.raises(InputError, match="a positive number with its unit"):
        parse_quantity("time_step", text, "time")


def test_a_duration_is_told_in_its_own_size():
    assert [duration(s) for s in (0.4, 59.4, 60, 750, 3600, 11_111)] == [
        "0 s",
        "59 s",
        "1 min 00 s",
        "12 min 30 s",
        "1 h 00 min",
        "3 h 05 min",
    ]


def coarse_pile(out, *more):
    return ["pile", "pellet", "--scale", "4", "--fill-level", "0.3", "--out", str(out), *more]


def test_a_pile_leaves_its_four_files_and_says_its_angle(tmp_path, capsys):
    assert main(coarse_pile(tmp_path / "out")) == 0
    said = capsys.readouterr().out
    files = {path.name for path in (tmp_path / "out").iterdir()}
    series = {"spheres.vtkhdf", "walls.vtkhdf"}
    assert files == {"result.h5", "pile.vtkhdf", "pile.png", "summary.json"} | series
    stored = read_result(tmp_path / "out" / "result.h5")
    assert f"repose angle {stored.summary['angle_deg']:.2f}" in said
    assert stored.case["scale"] == 4.0
    steps = read_steps(tmp_path / "out" / "spheres.vtkhdf")
    assert steps[0][0] == 0.0 and steps[1][0] == pytest.approx(0.05, abs=1e-4)
    # Some left over the edge; the walls lost the cylinder.
    assert steps[0][1].n_points == stored.summary["particles_filled"]
    assert steps[-1][1].n_points < steps[0][1].n_points
    walls = read_steps(tmp_path / "out" / "walls.vtkhdf")
    assert [set(walls[k][1]["Wall"]) for k in (0, -1)] == [{0, 1}, {0}]
    pile = pyvista.read(tmp_path / "out" / "pile.vtkhdf")
    np.testing.assert_array_equal(pile.points, stored.columns["particles/position"].values)
    assert stored.columns["particles/position"].units == "m"
    assert (
        json.loads((tmp_path / "out" / "summary.json").read_text())["angle_deg"]
        == stored.summary["angle_deg"]
    )


def test_a_pile_that_was_killed_and_resumed_has_the_same_bits(tmp_path, capsys):
    assert main(coarse_pile(tmp_path / "whole")) == 0
    killed = tmp_path / "killed"
    command = [sys.executable, "-m", "demcore", *coarse_pile(killed, "--checkpoint-seconds", "0")]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 120.0
    while not (killed / "run.checkpoint.previous").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert not (killed / "result.h5").exists()
    # The newest is spoiled as well: the one before it is taken, and a line says so once.
    (killed / "run.checkpoint").write_bytes(b"torn")
    capsys.readouterr()
    assert main(coarse_pile(killed, "--resume")) == 0
    said = "warning: checkpoint refused: run.checkpoint is not a Talus checkpoint or is truncated\n"
    assert capsys.readouterr().err == said
    for name in ("result.h5", "spheres.vtkhdf", "walls.vtkhdf"):
        assert (killed / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    assert sorted(path.name for path in killed.iterdir()) == sorted(
        path.name for path in (tmp_path / "whole").iterdir()
    )
    assert not (killed / "run.checkpoint").exists()
    # Recording is no part of the outcome.
    assert main(coarse_pile(tmp_path / "plain", "--frames", "none")) == 0
    assert (tmp_path / "plain" / "result.h5").read_bytes() == (killed / "result.h5").read_bytes()
    assert not list((tmp_path / "plain").glob("spheres*"))


def test_warnings_of_checkpoints_are_lines_and_others_stay_as_they_are(tmp_path, capsys):
    path = tmp_path / "c"
    checkpoint.save(path, {"identity": "another's"}, {})
    with checkpoint_warnings_as_lines():
        for _ in range(2):
            assert checkpoint.load_newest(path, "mine") is None
        with pytest.warns(UserWarning, match="about something else"):
            warnings.warn("about something else", UserWarning, stacklevel=1)
    assert capsys.readouterr().err == "warning: checkpoint refused: c is of another case or of other code\n"


def test_ctrl_c_saves_the_run_and_says_so_in_a_line(tmp_path):
    out = tmp_path / "out"
    command = [sys.executable, "-m", "demcore", *coarse_pile(out, "--checkpoint-seconds", "0")]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 120.0
    while not (out / "run.checkpoint").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130
    assert said.startswith("error: stopped on request at ")
    assert said.count("\n") == 1
    assert (out / "run.checkpoint").exists()


CUBE = """solid cube
facet normal 0 0 1
 outer loop
  vertex 0 0 0
  vertex 100 0 0
  vertex 0 100 0
 endloop
endfacet
endsolid cube
"""


def test_a_mesh_is_told_in_metres(tmp_path, capsys):
    file = tmp_path / "plate.stl"
    file.write_text(CUBE)
    assert main(["mesh", str(file), "--units", "mm", "--up", "y"]) == 0
    assert "1 triangles, 0.1 x 0 x 0.1 m, read in mm with y up, not watertight" in capsys.readouterr().out
    assert main(["mesh", str(file), "--units", "mm", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["upper"] == [0.1, 0.1, 0.0]


@pytest.mark.parametrize(
    ("before", "after", "more", "said"),
    [
        ("", "", [], "units: got None"),
        ("", "", ["--units", "feet"], "units: got 'feet'"),
        ("", "", ["--units", "mm", "--up", "w"], "up_axis"),
        ("0 100 0", "200 0 0", ["--units", "mm"], "degenerate"),
        ("0 100 0", "0 nan 0", ["--units", "mm"], "finite"),
        ("endsolid cube", "", ["--units", "mm"], "damaged"),
    ],
)
def test_a_bad_mesh_is_one_line(before, after, more, said, tmp_path, capsys):
    file = tmp_path / "plate.stl"
    file.write_text(CUBE.replace(before, after, 1) if before else CUBE)
    assert said in refused(["mesh", str(file), *more], capsys)


def test_a_mesh_that_is_not_there_is_one_line(tmp_path, capsys):
    assert "nowhere.stl" in refused(["mesh", str(tmp_path / "nowhere.stl"), "--units", "m"], capsys)


def test_verify_prints_a_list_as_json_and_fails_with_a_case(capsys, monkeypatch):
    # Every case runs in tests/verification; here it is what the command makes of them.
    monkeypatch.setattr(cases, "CASES", (bounce_heights,))
    assert main(["verify", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert set(printed[0]) == {"name", "source", "expected", "got", "tolerance", "passed"}
    assert len(printed) == 3
    assert all(case["passed"] for case in printed)

    def wrong():
        yield Outcome("a sphere that bounces too high", "nowhere", 1.0, 2.0, 0.1)

    monkeypatch.setattr(cases, "CASES", (wrong, bounce_heights))
    assert main(["verify"]) == 1
    assert "3 passed, 1 failed" in capsys.readouterr().out


def test_the_picture_shows_a_sphere_on_its_base():
    image = render_spheres(np.array([[0.0, 0.0, 0.05]]), np.array([0.05]), 0.3)
    colours = {tuple(c) for c in image.reshape(-1, 3)[::7]}
    assert BACKGROUND in colours
    assert STEEL in colours
    centre = image[int(image.shape[0] * 0.66 - 0.05 * 0.46 * 900 / 0.35), 450]
    assert tuple(centre) not in (BACKGROUND, STEEL)
    assert Image.fromarray(image).size == (900, 520)

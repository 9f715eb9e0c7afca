"""python -m demcore: what it writes, and that bad input is one line and exit status 2."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image

from demcore.__main__ import main
from demcore.picture import BACKGROUND, STEEL, render_spheres


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--scale", "50"], "scale"),
        (["--scale", "nan"], "scale"),
        (["--restitution", "1.4"], "particle_particle_restitution"),
        (["--rolling", "-1"], "rolling_resistance"),
        (["--time-step", "quick"], "time_step"),
        (["--fill-level", "2"], "fill_level"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(arguments, named, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["pile", "pellet", *arguments, "--out", str(out)]) == 2
    said = capsys.readouterr().err.strip()
    assert said.startswith(f"error: {named}: got ")
    assert "\n" not in said
    assert not out.exists()


def test_verify_prints_every_case_as_json(capsys):
    assert main(["verify", "--json"]) == 0
    cases = json.loads(capsys.readouterr().out)
    assert {"name", "source", "expected", "got", "tolerance", "passed"} <= set(cases[0])
    assert len(cases) > 40
    assert all(case["passed"] for case in cases)


def test_the_picture_shows_a_sphere_on_its_base():
    image = render_spheres(np.array([[0.0, 0.0, 0.05]]), np.array([0.05]), 0.3)
    colours = {tuple(c) for c in image.reshape(-1, 3)[::7]}
    assert BACKGROUND in colours
    assert STEEL in colours
    centre = image[int(image.shape[0] * 0.66 - 0.05 * 0.46 * 900 / 0.35), 450]
    assert tuple(centre) not in (BACKGROUND, STEEL)
    assert Image.fromarray(image).size == (900, 520)

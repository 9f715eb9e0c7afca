"""python -m demcore table7: the paper's numbers, the comparison, the noise, and runs that are never made twice."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import numpy as np
import pytest

from demcore.__main__ import main
from demcore.commands.table7 import comparison, parse_scales, sensitivities
from demcore.errors import Cancelled, InputError
from demcore.experiments import pile_batch
from demcore.experiments.contact_parameters import ContactParameters
from demcore.experiments.paper_tables import (
    CHANGES,
    TABLE_7,
    Angles,
    Trial,
    noise_of_difference,
    optimum_test,
    pooled_scatter,
    sensitivity_trials,
    table_7_trials,
)
from demcore.experiments.pile_batch import Outcome, run_trials, stored_outcome
from demcore.output.result_file import read_result


def outcome(material, angle, choice="", seed=1):
    trial = Trial(f"{material}{choice}{seed}", choice, optimum_test(material, 4.0, seed))
    if angle is None:
        return Outcome(trial, None, "never_settles: it still moves")
    return Outcome(trial, {"angle_deg": angle, "literal_angle_deg": angle - 9.0, "particles_filled": 100})


def test_the_optimum_is_the_papers_at_a_scale_that_the_angle_does_not_feel():
    test = optimum_test("coke", None, 2)
    assert test.parameters == ContactParameters(0.50, 0.80, 0.24, 0.48)
    assert test.diameters_across_base >= 12.0
    assert test.seed == 2
    trials = table_7_trials({"coke": None, "pellet": 3.0}, (1, 2))
    assert [t.test.material.name for t in trials] == ["coke", "coke", "pellet", "pellet"]
    assert len({t.name for t in trials}) == 4


def test_each_change_changes_one_thing_only():
    trials = sensitivity_trials("coke", 4.0, (1,))
    base = trials[0].test
    assert [t.choice for t in trials[1:]] == [told for told, _ in CHANGES.values()]
    for trial in trials[1:]:
        fields = [
            f.name for f in dataclasses.fields(base) if getattr(base, f.name) != getattr(trial.test, f.name)
        ]
        assert len(fields) == 1
        if fields == ["material"]:
            changed = [
                f.name
                for f in dataclasses.fields(base.material)
                if getattr(base.material, f.name) != getattr(trial.test.material, f.name)
            ]
            assert len(changed) == 1


def test_a_change_that_changes_nothing_is_left_out():
    # The pellet's sizes are uniform by mass as they are.
    told = CHANGES["uniform"][0]
    assert told not in {t.choice for t in sensitivity_trials("pellet", 4.0, (1,))}
    assert told in {t.choice for t in sensitivity_trials("sinter", 4.0, (1,))}


def test_means_scatter_and_noise_are_those_of_the_textbook():
    a, b = Angles((1.0, 2.0, 3.0)), Angles((4.0, 8.0))
    assert (a.mean, a.scatter) == (2.0, 1.0)
    assert b.scatter == pytest.approx(np.std((4.0, 8.0), ddof=1))
    # (2 * 1 + 1 * 8) / 3 degrees of freedom.
    assert pooled_scatter([a, b, Angles((5.0,))]) == pytest.approx(math.sqrt(10.0 / 3.0))
    assert noise_of_difference(a, b, 1.0) == pytest.approx(math.sqrt(1.0 / 3.0 + 1.0 / 2.0))
    assert math.isnan(Angles(()).mean) and math.isnan(Angles((1.0,)).scatter)
    assert Angles((1.0, math.nan, 3.0)).mean == 2.0
    assert math.isnan(pooled_scatter([Angles((1.0,))]))
    assert math.isnan(noise_of_difference(a, Angles(()), 1.0))


def test_the_comparison_stands_beside_table_7():
    rows = comparison([outcome("pellet", 26.0), outcome("pellet", 28.0, seed=2), outcome("coke", None)])
    assert [row["material"] for row in rows] == ["pellet", "coke"]
    assert rows[0]["paper_deg"] == list(TABLE_7["pellet"]) == [25.6, 25.0, 24.4]
    assert rows[0]["difference_deg"] == pytest.approx(27.0 - 25.0)
    assert rows[1]["angles_deg"] == [None] and rows[1]["difference_deg"] is None
    json.dumps(rows, allow_nan=False)


def test_the_largest_sensitivity_comes_first_with_its_noise():
    rows = sensitivities(
        [
            outcome("pellet", 25.0),
            outcome("pellet", 27.0, seed=2),
            outcome("pellet", 24.0, "little"),
            outcome("pellet", 26.0, "little", 2),
            outcome("pellet", 20.0, "much"),
            outcome("pellet", None, "much", 2),
        ]
    )
    assert [row["choice"] for row in rows] == ["as assumed", "much", "little"]
    assert [row["difference_deg"] for row in rows] == [0.0, -6.0, -1.0]
    assert rows[2]["standard_error_deg"] == pytest.approx(math.sqrt(2.0) * 1.0)
    assert rows[1]["standard_error_deg"] == pytest.approx(math.sqrt(2.0) * math.sqrt(1.5))
    json.dumps(rows, allow_nan=False)


def test_scales_are_read_by_material():
    assert parse_scales(["coke=3", "pellet=1.5"]) == {"coke": 3.0, "pellet": 1.5}


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--scale", "coke"], "scale"),
        (["--scale", "coke=two"], "scale"),
        (["--scale", "granite=2"], "scale"),
        (["--scale", "coke=2", "coke=3"], "scale"),
        (["--scale", "pellet=0"], "scale"),
        (["--scale", "pellet=nan"], "scale"),
        (["--seeds", "1", "1"], "seeds"),
        (["--seeds", "-1"], "seeds"),
        (["--processes", "0"], "processes"),
        (["--sensitivity", "granite"], "material"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(arguments, named, tmp_path, capsys):
    assert main(["table7", *arguments, "--out", str(tmp_path / "out")]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith(f"error: {named}: got ") and captured.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_table_is_made_once_and_its_runs_are_kept(tmp_path, capsys):
    arguments = ["table7", "--scale", "pellet=4", "--seeds", "1", "2", "--out", str(tmp_path), "--json"]
    assert main(arguments) == 0
    captured = capsys.readouterr()
    (row,) = json.loads(captured.out)
    assert captured.err.count("kept") == 0
    assert row["angles_deg"] == [
        read_result(tmp_path / f"pellet-scale4-seed{seed}.h5").summary["angle_deg"] for seed in (1, 2)
    ]
    assert row["angles_deg"][0] != row["angles_deg"][1]
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".h5", ".h5"]
    assert main(arguments) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out) == [row]
    assert captured.err.count("(kept)") == 2


def test_a_file_of_another_test_or_half_a_file_is_not_taken(tmp_path):
    trial = Trial("a", "", optimum_test("pellet", 4.0, 1))
    (made,) = run_trials([trial], tmp_path, 1, lambda _outcome: None)
    assert stored_outcome(trial, tmp_path).angle_deg == made.angle_deg
    other = Trial("a", "", optimum_test("pellet", 4.0, 2))
    assert stored_outcome(other, tmp_path) is None
    file = tmp_path / "a.h5"
    file.write_bytes(file.read_bytes()[:2000])
    assert stored_outcome(trial, tmp_path) is None


def test_two_trials_of_one_name_are_refused(tmp_path):
    trial = Trial("a", "", optimum_test("pellet", 4.0, 1))
    with pytest.raises(InputError, match="names of their own"):
        run_trials([trial, trial], tmp_path, 1, lambda _outcome: None)


def test_ctrl_c_while_compiling_is_not_lost(monkeypatch):
    def compiling(*_arguments, **_options):
        # As in a callback of the compiler: an exception raised here would go no further.
        with suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
        raise Cancelled("after the first chunk")

    monkeypatch.setattr(pile_batch, "run_pile_test", compiling)
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        pile_batch.compile_kernels(optimum_test("pellet", 4.0, 1))
    assert signal.getsignal(signal.SIGINT) is before


def test_ctrl_c_saves_what_runs_and_ends_at_once(tmp_path):
    command = [
        sys.executable,
        "-m",
        "demcore",
        "table7",
        "--scale",
        "coke=3",
        "--seeds",
        "1",
        "--out",
        str(tmp_path),
    ]
    # A shell's background job ignores Ctrl-C and hands that down to what it starts, these tests too.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    signal.signal(signal.SIGINT, before)
    # Time enough to start; wherever it is then, it has to end cleanly.
    time.sleep(15.0)
    os.killpg(process.pid, signal.SIGINT)
    # The compiler's optimizer hears no signal: a run that still compiles ends when that is over.
    _, said = process.communicate(timeout=250)
    assert process.returncode == 130
    assert said.strip().splitlines()[-1] == "error: interrupted"
    assert "Traceback" not in said
    assert not list(tmp_path.glob("*.h5"))

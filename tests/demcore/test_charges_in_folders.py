"""python -m demcore findings | compare: charges in folders are run once, and set beside each other."""

from __future__ import annotations

import json

import pytest

from demcore.__main__ import main
from demcore.commands import findings
from demcore.experiments.charge_case import ChargeTest, load_charge
from demcore.experiments.charge_result import describe_charge
from demcore.plant.plant_file import load_plant


def a_kept_charge(folder, seed=1, name="coke", **found):
    """A folder as `charge --out` leaves it, without its pictures."""
    test = ChargeTest(load_charge(name), load_plant(None), scale=10.0, seed=seed)
    usual = {
        "piles": 2,
        "near_height_m": 1.5,
        "far_height_m": 2.0,
        "near_size_m": 0.2,
        "far_size_m": 0.24,
        "depressions": ["behind the rod", "under the deflector"],
    }
    summary = {
        "findings": usual | found,
        "belt": {"stratification": 0.5, "rate_kg_s": 41.6},
        "inputs": describe_charge(test),
        "far_share_of_mass": None,
    }
    folder.mkdir(parents=True)
    (folder / "summary.json").write_text(json.dumps(summary))
    return folder


def test_groups_are_told_with_their_scatter_and_their_difference(tmp_path, capsys):
    """Far piles of 1.9, 2.0 and 2.1 m: 2 +- .1 m; of 1.5 and 1.7 m: 1.6 +- .14 m; the noise of the difference is
    sqrt(.01 / 3 + .02 / 2) = .1155 m."""
    coke = [a_kept_charge(tmp_path / f"c{k}", k, far_height_m=1.8 + 0.1 * k) for k in (1, 2, 3)]
    iron = [a_kept_charge(tmp_path / f"i{k}", k, "iron", far_height_m=1.3 + 0.2 * k) for k in (1, 2)]
    groups = [f"{name}={','.join(map(str, of))}" for name, of in (("coke", coke), ("iron", iron))]
    assert main(["compare", *groups]) == 0
    told = capsys.readouterr().out
    assert "| far_height_m | m | 2 ± 0.1 (3) | 1.6 ± 0.14 (2) | -0.4 | 0.1155 | stands out |" in told
    assert "| far_share_of_mass | 1 | – (0) | – (0) | – | – |" in told
    assert "| Their heights | coke | the far pile is much higher | 3 of 3 |" in told
    # 1.5 m beside 1.5 m are similar; 1.7 m differ by more than a tenth.
    assert "| Their heights | iron | the piles have similar heights | 1 of 2 |" in told


def test_every_place_of_the_ridge_has_its_share_of_each_jet(tmp_path, capsys):
    """Evenly over .2 m about -.096 m and about -.144 m; outside nearly everything falls to one side."""
    groups = []
    for name, middle in (("coke", -0.096), ("iron", -0.144)):
        folder = a_kept_charge(tmp_path / name)
        summary = json.loads((folder / "summary.json").read_text())
        summary["jet"] = {
            "ridge_at_m": [middle - 0.1, middle + 0.1],
            "far_of_that_ridge": [1.0, 0.0],
        }
        (folder / "summary.json").write_text(json.dumps(summary))
        groups.append(f"{name}={folder}")
    assert main(["compare", "--ridges", *groups]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert rows[0] == "| ridge at x, m | coke | iron |"
    assert "| -0.12 | 0.62 | 0.38 |" in rows
    assert (rows[2], rows[-1]) == ("| -0.20 | 1.00 | 0.78 |", "| -0.04 | 0.22 | 0.00 |")


@pytest.mark.parametrize("text", ["coke", "=here", "coke=", "coke=nowhere", "coke={tmp}"])
def test_what_is_no_group_of_charges_is_one_line(text, tmp_path, capsys):
    (tmp_path / "summary.json").write_text("[1, 2]")
    assert main(["compare", text.format(tmp=tmp_path)]) == 2
    assert capsys.readouterr().err.startswith("error: groups: got ")


def test_what_lies_there_is_not_run_again(tmp_path, capsys, monkeypatch):
    for seed in (1, 2):
        a_kept_charge(tmp_path / f"coke-10-{seed}", seed)
    ran = []
    monkeypatch.setattr(
        findings,
        "run_kept",
        lambda test, run, options, folder, write: (
            ran.append(folder.name),
            folder.rmdir(),
            a_kept_charge(folder, 3),
        ),
    )
    out = ["--out", str(tmp_path)]
    assert main(["findings", "--materials", "coke", "--seeds", "1", "2", "3", *out]) == 0
    assert ran == ["coke-10-3"]
    assert "| Piles | coke | two, near and far | 3 of 3 |" in capsys.readouterr().out


def test_another_charge_in_the_folder_is_refused(tmp_path, capsys):
    a_kept_charge(tmp_path / "coke-10-1", seed=2)
    out = ["--seeds", "1", "--out", str(tmp_path)]
    assert main(["findings", "--materials", "coke", *out]) == 2
    assert "another charge lies there" in capsys.readouterr().err


def test_bad_input_is_refused_before_anything_runs(tmp_path, capsys):
    for arguments in (["--materials", "granite"], ["--scale", "0"], ["--seeds", "-1"]):
        assert main(["findings", *arguments, "--out", str(tmp_path / "out")]) == 2
        assert capsys.readouterr().err.startswith("error: ")
    assert list(tmp_path.iterdir()) == []

"""A study of deflectors with a made-up plant: what is tried, written, taken up again, chosen and drawn."""

from __future__ import annotations

import json
import math
import pickle
import runpy
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from demcore.errors import InputError
from demcore.geometry.mesh_file import load_mesh
from demcore.plant.plant_file import load_plant
from demcore.plant.surfaces import deflector_mesh
from worker.deflector import __main__ as command
from worker.deflector import charges, spread
from worker.deflector.designs import Space, candidates, first_designs
from worker.deflector.pareto import pareto_set, pick, tchebycheff
from worker.deflector.picture import draw_pareto
from worker.deflector.record import Record
from worker.deflector.spread import Spread, on_processes
from worker.deflector.study import StudyPlan, arrays_of, front_of, run_study

PLANT = load_plant()
SPACE = Space(PLANT)
SMALL = StudyPlan(designs=8, initial=5)


def uneven(u: tuple[float, ...], material: str, seed: int) -> dict[str, Any]:
    """Mass is most even at .3 of every variable, size at .6; iron is worse by a tenth."""
    add = 0.1 if material == "iron" else 0.0
    mass, size = (sum((v - best) ** 2 for v in u) for best in (0.3, 0.6))
    return {"variation_of_mass": mass + add, "variation_of_size": 0.5 * size + add, "more": None}


def test_the_front_is_what_nothing_beats() -> None:
    f = np.array([[1.0, 4.0], [2.0, 2.0], [3.0, 3.0], [4.0, 1.0], [2.0, 2.0], [1.0, 5.0]])
    assert pareto_set(f) == [0, 1, 4, 3]
    assert pareto_set(f[:1]) == [0]


def test_weights_pick_along_the_front() -> None:
    f = np.array([[0.0, 1.0], [0.4, 0.4], [1.0, 0.0], [0.9, 0.9]])
    assert [pick(f, w) for w in ((1.0, 0.0), (0.5, 0.5), (0.0, 2.0))] == [0, 1, 2]
    assert tchebycheff(f, (0.5, 0.5))[1] == pytest.approx(0.2 + 0.05 * 0.4)
    for wrong in ((1.0,), (-1.0, 2.0), (0.0, 0.0), (math.nan, 1.0)):
        with pytest.raises(InputError, match="weights"):
            pick(f, wrong)


def test_designs_fit_the_plant_and_start_with_the_same_whatever_follows() -> None:
    few, more = (first_designs(SPACE, 1, n) for n in (4, 9))
    assert more[:4] == few
    assert all(SPACE.fits(u) for u in more)
    points = candidates(SPACE, 1, 7, np.array(few[:1]))
    assert len(points) > 50
    assert all(SPACE.fits(u) for u in points[::50])
    assert SPACE.deflector(SPACE.unit_of(PLANT.deflector)) == PLANT.deflector
    with pytest.raises(InputError, match=r"variables.edge_length"):
        Space(PLANT, (("edge_length", 1.0, 0.5),))
    with pytest.raises(InputError, match="so many devices"):
        first_designs(Space(PLANT, (("ridge_along", 5.0, 6.0),)), 1, 3)


@pytest.mark.slow
def test_a_study_gets_better_than_its_first_designs_and_is_repeatable(tmp_path: Path) -> None:
    plan = StudyPlan(designs=16, initial=6)
    runs = [run_study(SPACE, plan, uneven, Record(tmp_path / name)) for name in ("a", "b")]
    assert runs[0] == runs[1]
    _, f = arrays_of(runs[0])
    assert len(f) == 17
    assert f[7:, 0].min() < f[1:7, 0].min()
    assert f[7:, 1].min() < f[1:7, 1].min()
    assert runs[0][0].u == SPACE.unit_of(PLANT.deflector)
    both = runs[0][3].by_material
    assert both["iron"]["variation_of_mass"] == pytest.approx(both["coke"]["variation_of_mass"] + 0.1)


def test_a_study_that_was_killed_goes_on_as_if_it_had_not_been(tmp_path: Path) -> None:
    whole = run_study(SPACE, SMALL, uneven, Record(tmp_path / "whole"))
    count = 0

    def killed(u: tuple[float, ...], material: str, seed: int) -> dict[str, Any]:
        nonlocal count
        count += 1
        if count == 14:
            raise KeyboardInterrupt
        return uneven(u, material, seed)

    record = tmp_path / "killed"
    with pytest.raises(KeyboardInterrupt):
        run_study(SPACE, SMALL, killed, Record(record))
    with record.open("a") as file:
        file.write('{"number": 6, "mater')
    assert len(Record(record).rows) == 13
    assert run_study(SPACE, SMALL, uneven, Record(record)) == whole


def backwards(function: Callable[..., Any], calls: Sequence[tuple[Any, ...]]) -> Iterator[tuple[int, Any]]:
    """The last call ends first."""
    return ((k, function(*calls[k])) for k in reversed(range(len(calls))))


@pytest.mark.parametrize("spread", [backwards, on_processes(2)], ids=["backwards", "two processes"])
def test_charges_side_by_side_make_the_same_study(tmp_path: Path, spread: Spread) -> None:
    """Whatever ends first: designs, objectives and what follows from them are those of one after the other."""
    alone = run_study(SPACE, SMALL, uneven, Record(tmp_path / "alone.jsonl"))
    record = Record(tmp_path / "beside.jsonl")
    assert run_study(SPACE, SMALL, uneven, record, spread=spread) == alone
    assert len(record.rows) == 2 * (SMALL.designs + 1)


def test_a_design_whose_charge_failed_is_passed_over(tmp_path: Path) -> None:
    def fails_once(u: tuple[float, ...], material: str, seed: int) -> dict[str, Any]:
        return {} if u == SPACE.unit_of(PLANT.deflector) and material == "iron" else uneven(u, material, seed)

    designs = run_study(SPACE, SMALL, fails_once, Record(tmp_path / "record"))
    assert not designs[0].has_result
    assert 0 not in front_of(designs)
    draw_pareto(designs, tmp_path / "pareto.png", chosen=3)
    colours = np.unique(np.array(Image.open(tmp_path / "pareto.png")).reshape(-1, 3), axis=0)
    assert len(colours) > 3


def test_the_command_leaves_the_chosen_device(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    charged = []

    def charge_of(plant: Any, material: str, scale: float, seed: int) -> dict[str, Any]:
        charged.append((material, scale, seed))
        return uneven(SPACE.unit_of(plant.deflector), material, seed) | {"variation_of_mass": seed / 1000.0}

    monkeypatch.setattr(charges, "charge_of", charge_of)
    out = tmp_path / "out"
    words = [
        "--designs",
        "4",
        "--initial",
        "3",
        "--weights",
        "0,1",
        "--confirm-scale",
        "8",
        "--out",
        str(out),
    ]
    assert command.main(words) == 0
    study = json.loads((out / "study.json").read_text())
    assert len(study["designs"]) == 5
    chosen = study["designs"][study["chosen"]]["deflector"]
    again = load_plant(out / "chosen.toml").deflector
    assert again.ridge_across == pytest.approx(chosen["ridge_across"], abs=1e-12)
    mesh, _ = load_mesh(out / "chosen.stl", "mm")
    expected = deflector_mesh(again).vertices
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx(np.ptp(expected, axis=0), abs=1e-6)
    assert {"pareto.png", "chosen.png", "record.jsonl"} <= {file.name for file in out.iterdir()}
    row = next(row for row in study["confirmed"]["coke"] if row["name"] == "variation_of_mass")
    assert row["groups"]["present"] == {
        "mean": pytest.approx(1.002),
        "sd": pytest.approx(0.001),
        "charges": 3,
    }
    assert "variation_of_mass: present 1.002 +- 0.001, chosen 1.002" in capsys.readouterr().out
    # Five designs, then two devices, each with both materials and three fresh seeds; and nothing twice.
    assert len(charged) == 10 + 12
    assert sorted(set(charged[10:])) == [(m, 8.0, 1001 + k) for m in ("coke", "iron") for k in range(3)]
    assert command.main(words) == 0
    assert len(charged) == 22
    assert json.loads((out / "study.json").read_text()) == study


@pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning")  # imported above already
def test_what_the_command_hands_to_processes_is_found_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`python -m` runs a module called `__main__`, which a spawned process does not have."""
    handed = []

    def to_processes(count: int) -> Spread:
        def spread(function: Any, calls: Sequence[tuple[Any, ...]]) -> Iterator[tuple[int, Any]]:
            handed.append(pickle.dumps((function, list(calls))))
            return iter(())

        return spread

    monkeypatch.setattr(spread, "on_processes", to_processes)
    monkeypatch.setattr(
        sys, "argv", ["worker.deflector", "--designs", "3", "--initial", "3", "--processes", "2"]
    )
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        runpy.run_module("worker.deflector", run_name="__main__", alter_sys=True)
    assert ended.value.code == 1  # no charge came to an end
    assert handed and all(b"__main__" not in each for each in handed)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--weights", "half"], "weights"),
        (["--designs", "2"], "designs"),
        (["--materials", "granite"], "one of coke, iron"),
        (["--scale", "0"], "scale: got 0.0"),
        (["--plant", "nowhere.toml"], "plant_file"),
        (["--processes", "0"], "processes: got 0, allowed is 1 or more"),
    ],
)
def test_bad_input_is_one_line(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(words) == 2
    assert said in capsys.readouterr().err

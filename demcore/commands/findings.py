"""python -m demcore findings: the paper's four findings, both materials, several seeds; what is there is kept."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from demcore.commands.arguments import output_folder
from demcore.commands.charge import write_files
from demcore.commands.compare import finding_lines, number_lines, read_summary
from demcore.commands.kept_run import RunOptions, run_kept
from demcore.commands.table7 import check_seeds
from demcore.dormancy import Dormancy
from demcore.errors import InputError
from demcore.experiments.charge_case import ChargeTest, charge_names, load_charge
from demcore.experiments.charge_comparison import compare
from demcore.plant.plant_file import load_plant

CHECKPOINT_SECONDS = 30.0


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Its arguments."""
    table = commands.add_parser("findings", help="the paper's four findings, over seeds, for coke and iron")
    table.add_argument("--materials", nargs="+", default=list(charge_names()), help="which charges")
    table.add_argument("--scale", type=float, default=10.0, help="coarse-graining factor (default 10)")
    table.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    table.add_argument("--plant", type=Path, metavar="FILE", help="what differs from the shipped plant")
    table.add_argument("--no-dormancy", action="store_true", help="compute particles that do nothing, too")
    table.add_argument(
        "--out", type=Path, default=Path("findings"), help="folder; what is there is not run again"
    )
    table.set_defaults(run=findings)


def findings(arguments: argparse.Namespace) -> int:
    """Charge what is missing in --out, then print the tables of `compare`. Everything is checked first."""
    check_seeds(arguments.seeds)
    plant, dormancy = load_plant(arguments.plant), None if arguments.no_dormancy else Dormancy()
    tests = {
        f"{name}-{arguments.scale:g}-{seed}": ChargeTest(
            load_charge(name), plant, scale=arguments.scale, seed=seed, dormancy=dormancy
        )
        for name in arguments.materials
        for seed in arguments.seeds
    }
    groups: dict[str, list[dict[str, Any]]] = {}
    with output_folder(arguments.out) as folder:
        for name, test in tests.items():
            groups.setdefault(test.charge.name, []).append(charge_once(test, folder / name))
    for line in (*finding_lines(groups), "", *number_lines(compare(groups), list(groups))):
        print(line)
    return 0


def charge_once(test: ChargeTest, folder: Path) -> dict[str, Any]:
    """The summary of the charge in this folder, which is run, or gone on with, unless it lies there finished.

    Raises InputError where another charge lies, and what a charge raises.
    """
    from demcore.experiments.charge_result import describe_charge
    from demcore.experiments.charge_test import run_charge

    path = folder / "summary.json"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        print(f"{folder.name} runs", file=sys.stderr, flush=True)
        options = RunOptions(1, True, CHECKPOINT_SECONDS, None)
        run_kept(test, run_charge, options, folder, write_files)
    found = read_summary(folder)
    if found.get("inputs") != json.loads(json.dumps(describe_charge(test))):
        raise InputError("out", str(folder), "a folder of its own: another charge lies there")
    return found

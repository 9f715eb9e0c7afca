"""python -m demcore compare coke=FOLDER,FOLDER iron=FOLDER: charges that lie in folders, beside each other."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from demcore.errors import InputError
from demcore.experiments.charge_comparison import Group, Row, compare
from demcore.experiments.charge_findings import agreement

# Places of the ridge that are told, x in m, unless nearly everything falls to one side.
RIDGES = tuple(k / 50.0 for k in range(-25, 26))
EVERYTHING = 0.85


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Its arguments."""
    run = commands.add_parser("compare", help="charges kept in folders, beside the scatter of their seeds")
    run.add_argument("groups", nargs="+", metavar="NAME=FOLDER,FOLDER", help="where `charge --out` left them")
    run.add_argument(
        "--ridges",
        action="store_true",
        help="instead: what every place of the deflector's ridge would divide",
    )
    run.set_defaults(run=compare_charges)


def compare_charges(arguments: argparse.Namespace) -> int:
    """Print two tables in Markdown: the paper's findings, and every number with its scatter."""
    groups = dict(_group(text) for text in arguments.groups)
    if arguments.ridges:
        for line in ridge_lines(groups):
            print(line)
        return 0
    for line in (*finding_lines(groups), "", *number_lines(compare(groups), list(groups))):
        print(line)
    return 0


def _group(text: str) -> tuple[str, list[dict[str, Any]]]:
    name, sign, folders = text.partition("=")
    if not sign or not name or not folders:
        raise InputError("groups", text, "NAME=FOLDER,FOLDER")
    return name, [read_summary(Path(folder)) for folder in folders.split(",")]


def read_summary(folder: Path) -> dict[str, Any]:
    """What `charge` wrote. Raises InputError where there is none."""
    path = folder / "summary.json"
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise InputError(
            "groups", str(folder), "a folder with the summary.json of a finished charge"
        ) from None
    if not isinstance(found, dict) or "findings" not in found:
        raise InputError("groups", str(path), "the summary of a charge")
    return found


def finding_lines(groups: dict[str, list[dict[str, Any]]]) -> list[str]:
    """A row for each finding and group: in how many of its charges it comes out."""
    rows = ["| finding | group | in the plant | comes out in |", "| --- | --- | --- | --- |"]
    for name, summaries in groups.items():
        for finding, plant, agree in agreement(summaries):
            rows.append(f"| {finding} | {name} | {plant} | {agree} of {len(summaries)} |")
    return rows


def number_lines(rows: Sequence[Row], names: Sequence[str]) -> list[str]:
    """A row for each number: mean and standard deviation by group; of two groups the difference and its noise."""
    two = len(names) == 2
    heads = ["number", "unit", *names, *(["difference", "its noise", ""] if two else [])]
    lines = ["| " + " | ".join(heads) + " |", "| --- " * len(heads) + "|"]
    for row in rows:
        cells = [row.name, row.unit, *(_mean(row.groups[name]) for name in names)]
        if two:
            told = {None: "", True: "stands out", False: "within noise"}[row.stands_out]
            cells += [_number(row.difference), _number(row.noise), told]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def ridge_lines(groups: dict[str, list[dict[str, Any]]]) -> list[str]:
    """A row for each place of the ridge: the share of each group's jet that falls beyond it, mean over its
    charges. Grains that rebound from the deflector to above where the jet is read count too, a tenth at most."""
    lines = [f"| ridge at x, m | {' | '.join(groups)} |", "| --- " * (len(groups) + 1) + "|"]
    for x in RIDGES:
        shares = [np.mean([_beyond(summary, x) for summary in of]) for of in groups.values()]
        if any(EVERYTHING > share > 1.0 - EVERYTHING for share in shares):
            lines.append(f"| {x:+.2f} | " + " | ".join(f"{share:.2f}" for share in shares) + " |")
    return lines


def _beyond(summary: dict[str, Any], x: float) -> float:
    jet = summary["jet"]
    return float(np.interp(x, jet["ridge_at_m"], jet["far_of_that_ridge"], left=1.0, right=0.0))


def _mean(group: Group) -> str:
    spread = f" ± {group.sd:.2g}" if math.isfinite(group.sd) else ""
    return f"{_number(group.mean)}{spread} ({group.charges})"


def _number(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else "–"

"""python -m demcore table7: the paper's repeatability table beside ours, and what moves the angle."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from demcore.commands.arguments import check_at_least, output_folder
from demcore.errors import InputError
from demcore.experiments.paper_tables import (
    TABLE_7,
    Angles,
    noise_of_difference,
    pooled_scatter,
    sensitivity_trials,
    table_7_trials,
)

if TYPE_CHECKING:
    from demcore.experiments.pile_batch import Outcome


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Its arguments."""
    table = commands.add_parser("table7", help="the paper's repose angles beside ours, at its optimum")
    table.add_argument(
        "--scale",
        nargs="+",
        default=[],
        metavar="MATERIAL=FACTOR",
        help="coarse-graining, and which materials (default: all, each with 12 diameters across the base)",
    )
    table.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    table.add_argument(
        "--sensitivity", metavar="MATERIAL", help="instead: one unpublished choice changed at a time"
    )
    table.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    table.add_argument(
        "--out", type=Path, default=Path("table7"), help="folder; what is there is not run again"
    )
    table.add_argument("--json", action="store_true", help="print the rows as JSON")
    table.set_defaults(run=table7)


def table7(arguments: argparse.Namespace) -> int:
    """Run what is missing in --out, then print the table; status 1 if a run failed."""
    scales = parse_scales(arguments.scale)
    check_at_least("processes", arguments.processes, 1)
    check_seeds(arguments.seeds)
    if arguments.sensitivity is None:
        trials = table_7_trials(scales or dict.fromkeys(TABLE_7), arguments.seeds)
    else:
        scale = scales.get(arguments.sensitivity)
        trials = sensitivity_trials(arguments.sensitivity, scale, arguments.seeds)
    with output_folder(arguments.out) as folder:
        from demcore.experiments.pile_batch import run_trials

        done = 0

        def report(outcome: Outcome) -> None:
            nonlocal done
            done += 1
            print(f"[{done}/{len(trials)}] {tell(outcome)}", file=sys.stderr, flush=True)

        outcomes = run_trials(trials, folder, arguments.processes, report)
    if arguments.sensitivity is None:
        rows = comparison(outcomes)
        texts = [comparison_line(row) for row in rows]
    else:
        rows = sensitivities(outcomes)
        texts = [sensitivity_line(row) for row in rows]
    if arguments.json:
        print(json.dumps(rows, indent=1))
    else:
        print("\n".join(texts))
    return 1 if any(outcome.summary is None for outcome in outcomes) else 0


def check_seeds(seeds: list[int]) -> None:
    """Raises InputError for a seed below 0 or twice the same."""
    for seed in seeds:
        check_at_least("seeds", seed, 0)
    if len(set(seeds)) < len(seeds):
        raise InputError("seeds", seeds, "seeds that differ")


def parse_scales(texts: list[str]) -> dict[str, float | None]:
    """MATERIAL=FACTOR by material. Raises InputError for anything else."""
    scales: dict[str, float | None] = {}
    for text in texts:
        material, _, factor = text.partition("=")
        if material not in TABLE_7 or material in scales:
            raise InputError("scale", text, "MATERIAL=FACTOR, once each for " + ", ".join(TABLE_7))
        try:
            scales[material] = float(factor)
        except ValueError:
            raise InputError("scale", text, "MATERIAL=FACTOR with a number, as coke=3") from None
    return scales


def tell(outcome: Outcome) -> str:
    """A finished run in a line."""
    if outcome.summary is None:
        return f"{outcome.trial.name}: {outcome.failure}"
    kept = " (kept" + (", by other code)" if outcome.by_other_code else ")") if outcome.was_there else ""
    literal = outcome.summary["literal_angle_deg"]
    return f"{outcome.trial.name}: {outcome.angle_deg:.2f} deg, literal {literal:.2f}{kept}"


def comparison(outcomes: list[Outcome]) -> list[dict[str, Any]]:
    """A row per material: ours, the paper's, and the difference of the means. Angles in degrees."""
    groups: dict[str, list[Outcome]] = defaultdict(list)
    for outcome in outcomes:
        groups[outcome.trial.test.material.name].append(outcome)
    rows = []
    for material, group in groups.items():
        test = group[0].trial.test
        ours, paper = Angles(tuple(o.angle_deg for o in group)), Angles(TABLE_7[material])
        literal = [o.summary["literal_angle_deg"] for o in group if o.summary is not None]
        rows.append(
            {
                "material": material,
                "scale": test.scale,
                "diameters_across_base_radius": test.diameters_across_base,
                "seeds": [o.trial.test.seed for o in group],
                "angles_deg": [_or_none(o.angle_deg) for o in group],
                "mean_deg": _or_none(ours.mean),
                "scatter_deg": _or_none(ours.scatter),
                "paper_deg": list(paper.values),
                "paper_mean_deg": paper.mean,
                "paper_scatter_deg": paper.scatter,
                "difference_deg": _or_none(ours.mean - paper.mean),
                "literal_angles_deg": literal,
                "particles": [o.summary["particles_filled"] for o in group if o.summary is not None],
            }
        )
    return rows


def comparison_line(row: dict[str, Any]) -> str:
    """Ours and the paper's angles of a material."""
    ours, paper = (
        f"{listed(row[angles])} mean {one_decimal(row[mean])} +- {one_decimal(row[scatter])}"
        for angles, mean, scatter in (
            ("angles_deg", "mean_deg", "scatter_deg"),
            ("paper_deg", "paper_mean_deg", "paper_scatter_deg"),
        )
    )
    return (
        f"{row['material']:<7} scale {row['scale']:<5g} ours {ours}   paper {paper}   "
        f"difference {_signed(row['difference_deg'])}   literal {listed(row['literal_angles_deg'])}"
    )


def sensitivities(outcomes: list[Outcome]) -> list[dict[str, Any]]:
    """A row per choice: how far it moves the mean angle, and the standard error of that, largest first."""
    groups: dict[str, list[float]] = defaultdict(list)
    for outcome in outcomes:
        groups[outcome.trial.choice].append(outcome.angle_deg)
    angles = {choice: Angles(tuple(values)) for choice, values in groups.items()}
    scatter, base = pooled_scatter(list(angles.values())), angles.pop("")
    rows: list[dict[str, Any]] = [
        {
            "choice": choice,
            "angles_deg": [_or_none(v) for v in changed.values],
            "difference_deg": _or_none(changed.mean - base.mean),
            "standard_error_deg": _or_none(noise_of_difference(base, changed, scatter)),
        }
        for choice, changed in angles.items()
    ]
    rows.sort(key=lambda row: -abs(row["difference_deg"] or 0.0))
    first = {
        "choice": "as assumed",
        "angles_deg": [_or_none(v) for v in base.values],
        "difference_deg": 0.0,
        "standard_error_deg": 0.0,
    }
    return [first, *rows]


def sensitivity_line(row: dict[str, Any]) -> str:
    """A choice, what it does, and the noise."""
    return (
        f"{row['choice']:<58} {_signed(row['difference_deg'])} +- {one_decimal(row['standard_error_deg'])} deg   "
        f"{listed(row['angles_deg'])}"
    )


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def one_decimal(value: float | None) -> str:
    """A number in a column; a dash for none."""
    return "   -" if value is None else f"{value:4.1f}"


def _signed(value: float | None) -> str:
    return "   -" if value is None else f"{value:+5.1f}"


def listed(values: list[float | None]) -> str:
    """Numbers with slashes between."""
    return "/".join(one_decimal(v).strip() for v in values)

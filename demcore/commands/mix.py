"""python -m demcore mix NAME: the angle of a mix by the paper's averaging and pair by pair, beside its parts'."""

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
from demcore.commands.table7 import check_seeds, listed, one_decimal, tell
from demcore.experiments.mix_trials import mix_trials
from demcore.experiments.paper_tables import Angles, pooled_scatter

if TYPE_CHECKING:
    from demcore.experiments.pile_batch import Outcome


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Its arguments."""
    table = commands.add_parser("mix", help="a mix by averaged and by pair-wise parameters")
    table.add_argument("material", nargs="?", default="sinter65_pellet35", help="default: sinter65_pellet35")
    table.add_argument("--scale", type=float, help="coarse-graining (default: 12 diameters across the base)")
    table.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    table.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    table.add_argument("--out", type=Path, default=Path("mix"), help="folder; what is there is not run again")
    table.add_argument("--json", action="store_true", help="print the rows as JSON")
    table.set_defaults(run=mix)


def mix(arguments: argparse.Namespace) -> int:
    """Run what is missing in --out, then print the table; status 1 if a run failed."""
    check_at_least("processes", arguments.processes, 1)
    check_seeds(arguments.seeds)
    trials = mix_trials(arguments.material, arguments.scale, arguments.seeds)
    with output_folder(arguments.out) as folder:
        from demcore.experiments.pile_batch import run_trials

        outcomes = run_trials(
            trials, folder, arguments.processes, lambda o: print(tell(o), file=sys.stderr, flush=True)
        )
    rows = mix_rows(outcomes)
    print(json.dumps(rows, indent=1) if arguments.json else "\n".join(mix_line(row) for row in rows))
    return 1 if any(outcome.summary is None for outcome in outcomes) else 0


def mix_rows(outcomes: list[Outcome]) -> list[dict[str, Any]]:
    """A row per way, in their order: angles of the seeds, mean and its standard error by the pooled scatter."""
    groups: dict[str, list[Outcome]] = defaultdict(list)
    for outcome in outcomes:
        groups[outcome.trial.choice].append(outcome)
    angles = {way: Angles(tuple(o.angle_deg for o in group)) for way, group in groups.items()}
    scatter = pooled_scatter(list(angles.values()))
    rows = []
    for way, found in angles.items():
        error = scatter / math.sqrt(len(found.sound)) if found.sound else math.nan
        test = groups[way][0].trial.test
        rows.append(
            {
                "way": way,
                "scale": test.scale,
                "diameters_across_base_radius": test.diameters_across_base,
                "angles_deg": [a if math.isfinite(a) else None for a in found.values],
                "mean_deg": found.mean if math.isfinite(found.mean) else None,
                "standard_error_deg": error if math.isfinite(error) else None,
            }
        )
    return rows


def mix_line(row: dict[str, Any]) -> str:
    """A way, its mean angle and its seeds'."""
    mean, error = one_decimal(row["mean_deg"]), one_decimal(row["standard_error_deg"])
    return f"{row['way']:<46} {mean} +- {error} deg   {listed(row['angles_deg'])}   scale {row['scale']:g}"

"""python -m demcore verify | bench | pile: the core on its own, without the service.

Bad input ends with one line and exit status 2; a failed verification or simulation with status 1.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from demcore import checkpoint
from demcore.errors import InputError, SimulationError
from demcore.material import load_material, material_names
from demcore.rig import load_rig

BAD_INPUT = 2
# The shell's own status for a program that Ctrl-C ended: 128 + SIGINT.
INTERRUPTED = 130

# Table 5 of the paper: particle-particle and particle-wall friction, restitution, rolling resistance.
TABLE_5 = {
    "coke": (0.50, 0.80, 0.24, 0.48),
    "sinter": (0.40, 0.40, 0.40, 0.24),
    "pellet": (0.40, 0.40, 0.20, 0.20),
}


def verify(arguments: argparse.Namespace) -> int:
    """Print every case of physics.md section 3, with --slow also the long ones; status 1 if one fails."""
    from demcore.verification.cases import CASES, SLOW_CASES
    from demcore.verification.outcome import run_cases

    outcomes = []
    for outcome in run_cases(CASES + SLOW_CASES if arguments.slow else CASES):
        outcomes.append(outcome)
        if not arguments.json:
            word = "ok  " if outcome.passed else "FAIL"
            print(
                f"{word} {outcome.name:<60} expected {outcome.expected:<12.6g} got {outcome.got:<12.6g} "
                f"+- {outcome.tolerance:<8.2g} {outcome.source}",
                flush=True,
            )
    failed = sum(not o.passed for o in outcomes)
    if arguments.json:
        print(json.dumps([o.record() for o in outcomes], indent=1))
    else:
        print(f"{len(outcomes) - failed} passed, {failed} failed")
    return 1 if failed else 0


def pile(arguments: argparse.Namespace) -> int:
    """Run one pile test, show progress, write result.vtkhdf, summary.json and pile.png."""
    from demcore.experiments.pile_case import ContactParameters, PileTest
    from demcore.experiments.pile_test import Progress, run_pile_test
    from demcore.picture import draw_pile

    given = (arguments.friction, arguments.wall_friction, arguments.restitution, arguments.rolling)
    values = [a if a is not None else b for a, b in zip(given, TABLE_5[arguments.material], strict=True)]
    test = PileTest(
        load_material(arguments.material),
        load_rig(arguments.material),
        ContactParameters(*values),
        scale=arguments.scale,
        seed=arguments.seed,
        fill_level=arguments.fill_level,
        time_step=arguments.time_step,
    )
    folder: Path = arguments.out
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "run.checkpoint"
    if not arguments.resume:
        checkpoint.discard(path)
    shown = 0.0

    def show(progress: Progress) -> bool:
        nonlocal shown
        if time.monotonic() - shown >= arguments.report_every:
            shown = time.monotonic()
            left = "?" if math.isnan(progress.seconds_left) else f"{progress.seconds_left:.0f}"
            bar = "#" * round(20 * progress.fraction)
            print(
                f"\r[{bar:<20}] {progress.phase:<9} {progress.time_s:6.2f} s simulated, {progress.particles} "
                f"particles, {progress.particle_steps_per_s:.2e} particle-steps/s, {left} s left  ",
                end="",
                file=sys.stderr,
                flush=True,
            )
        return True

    result = run_pile_test(test, show, arguments.threads, path, arguments.checkpoint_seconds)
    print(file=sys.stderr)
    result.write(folder / "result.vtkhdf")
    draw_pile(result.positions, result.radii, test.rig.base_radius, folder / "pile.png")
    summary = result.summary()
    (folder / "summary.json").write_text(json.dumps(summary, indent=1) + "\n", encoding="utf-8")
    checkpoint.discard(path)
    rate = summary["particle_steps"] / max(summary["wall_s"], 1e-9)
    print(
        f"repose angle {result.angle_deg:.2f} +- {result.angle_sd_deg:.2f} deg (surface scan, standard error of "
        f"{len(result.scan.sectors)} sectors); the paper's literal reading {result.literal_angle_deg:.2f} deg\n"
        f"mass on the base {summary['mass_on_base_kg']:.2f} kg of {summary['mass_filled_kg']:.2f} kg, "
        f"{summary['particles_on_base']} of {summary['particles_filled']} particles\n"
        f"simulated {summary['simulated_s']:.2f} s in {summary['wall_s']:.1f} s, {rate:.2e} particle-steps/s, "
        f"scale {test.scale:g}, {test.diameters_across_base:.1f} mean diameters across the base radius\n"
        f"files in {folder}: result.vtkhdf, summary.json, pile.png"
    )
    return 0


def bench(arguments: argparse.Namespace) -> int:
    """Time the settled beds; a line per bed, law and thread count, or a JSON list of them."""
    from demcore.bench.beds import CONTAINERS, LAWS
    from demcore.bench.rates import most_threads
    from demcore.bench.report import HEADER, Bench, Row, line, measure, size_ratio_lines

    task = Bench(
        arguments.bed or tuple(CONTAINERS),
        arguments.law or LAWS,
        arguments.threads or tuple(range(1, min(2, most_threads()) + 1)),
        arguments.against == "liggghts",
        arguments.beds,
        arguments.repeats,
        arguments.particle_steps,
    )
    headed = False

    def report(row: Row) -> None:
        nonlocal headed
        if not arguments.json:
            print(line(row) if headed else f"{HEADER}\n{line(row)}", flush=True)
        headed = True

    rows = measure(task, report)
    if arguments.json:
        print(json.dumps([row.record() for row in rows], indent=1))
    else:
        print(*size_ratio_lines(rows), sep="\n")
    return 0


def parser() -> argparse.ArgumentParser:
    """The command line."""
    top = argparse.ArgumentParser(prog="python -m demcore", description=__doc__)
    commands = top.add_subparsers(dest="command", required=True)
    check = commands.add_parser("verify", help="closed forms against the core")
    check.add_argument("--json", action="store_true", help="print a list of cases as JSON")
    check.add_argument("--slow", action="store_true", help="also the cases that take minutes each")
    check.set_defaults(run=verify)
    speed = commands.add_parser("bench", help="particle-steps per second on settled beds")
    speed.add_argument("--json", action="store_true", help="print a list of measurements as JSON")
    speed.add_argument("--against", choices=["liggghts"], help="run that program on the same beds in turns")
    speed.add_argument(
        "--bed", action="append", help="cylinder, box, mono or ratio10; may be repeated (default: all)"
    )
    speed.add_argument("--beds", type=Path, metavar="FOLDER", help="read the beds' .npz files from FOLDER")
    speed.add_argument("--law", action="append", help="hertz or paper; may be repeated (default: both)")
    speed.add_argument("--threads", type=int, nargs="+", help="thread counts (default: 1 2)")
    speed.add_argument("--repeats", type=int, default=3, help="turns; of each the fastest counts")
    speed.add_argument("--particle-steps", type=int, default=4_000_000, help="work in one turn")
    speed.set_defaults(run=bench)
    run = commands.add_parser("pile", help="one pile test")
    run.add_argument("material", choices=material_names())
    run.add_argument("--scale", type=float, default=2.0, help="coarse-graining factor (default 2)")
    run.add_argument("--seed", type=int, default=1)
    run.add_argument("--fill-level", type=float, default=1.0, help="share of the cylinder's height")
    run.add_argument("--friction", type=float, help="between particles (default: the paper's Table 5)")
    run.add_argument("--wall-friction", type=float)
    run.add_argument("--restitution", type=float)
    run.add_argument("--rolling", type=float)
    run.add_argument("--time-step", default="fast", help="fast or paper")
    run.add_argument("--threads", type=int, default=1)
    run.add_argument("--out", type=Path, default=Path("pile"), help="folder for the files")
    run.add_argument("--resume", action="store_true", help="continue from the checkpoint in --out")
    run.add_argument("--checkpoint-seconds", type=float, default=30.0)
    run.add_argument("--report-every", type=float, default=0.5)
    run.set_defaults(run=pile)
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; the exit status."""
    parsed = parser().parse_args(arguments)
    try:
        return int(parsed.run(parsed))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return BAD_INPUT
    except SimulationError as error:
        print(f"\nerror: {error.kind}: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nerror: interrupted", file=sys.stderr)
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())

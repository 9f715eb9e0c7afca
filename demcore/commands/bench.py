"""python -m demcore bench: particle-steps per second on settled beds, against LIGGGHTS if asked."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from demcore.bench.report import Bench


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Its arguments."""
    speed = commands.add_parser("bench", help="particle-steps per second on settled beds")
    speed.add_argument("--json", action="store_true", help="print a list of measurements as JSON")
    speed.add_argument("--against", choices=["liggghts"], help="run that program on the same beds in turns")
    speed.add_argument(
        "--bed", action="append", help="cylinder, box, mono or ratio10; may be repeated (default: all)"
    )
    speed.add_argument("--beds", type=Path, metavar="FOLDER", help="read the beds' .npz files from FOLDER")
    speed.add_argument("--law", action="append", help="hertz or paper; may be repeated (default: both)")
    speed.add_argument("--threads", type=int, nargs="+", help="thread counts (default: 1 2)")
    speed.add_argument(
        "--first-call",
        action="store_true",
        help="instead: seconds of the first step, compiled and from the cache",
    )
    speed.add_argument("--repeats", type=int, default=3, help="turns; of each the fastest counts")
    speed.add_argument("--particle-steps", type=int, default=4_000_000, help="work in one turn")
    speed.add_argument(
        "--dormancy", action="store_true", help="let the beds lie still, then each law with dormancy too"
    )
    speed.set_defaults(run=bench)


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
        arguments.dormancy,
    )
    if arguments.first_call:
        return first_call(task, arguments.json)
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
        for text in size_ratio_lines(rows):
            print(text)
    return 0


def first_call(task: Bench, as_json: bool) -> int:
    """Compile in new processes, per law and thread count."""
    from demcore.bench.compilation import first_calls

    rows = []
    for law in task.laws:
        for threads in task.threads:
            compiled, cached = first_calls(law, threads)
            rows.append({"law": law, "threads": threads, "compiled_s": compiled, "cached_s": cached})
            if not as_json:
                print(f"{law}, {threads} threads: first call {compiled:.1f} s, from the cache {cached:.2f} s")
    if as_json:
        print(json.dumps(rows, indent=1))
    return 0

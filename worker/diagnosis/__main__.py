"""`python -m worker.diagnosis bench [--json] [--cases 600] [--seed S] [--ablations N]`: see bench.py."""

from __future__ import annotations

import json
import secrets
import sys

from threadpoolctl import threadpool_limits

from service.domain.errors import InvalidValue
from worker.diagnosis.bench import HEADER, Report, as_line, bench
from worker.diagnosis.result import Result
from worker.optimizer.__main__ import OneLineParser, whole

CASES = 600


def parser() -> OneLineParser:
    top = OneLineParser(prog="python -m worker.diagnosis", description="The diagnosis's own commands.")
    commands = top.add_subparsers(dest="command", required=True)
    command = commands.add_parser("bench", help="the analytic tier against the marks of the design")
    command.add_argument("--json", action="store_true", help="utility and marks as JSON instead of the table")
    command.add_argument("--cases", type=whole(10, 100_000), default=CASES, help="data sets, about")
    command.add_argument("--seed", type=whole(0, 10**6), default=None, help="drawn and printed if not given")
    few = "cases of each ablation; a fifth of all if not given"
    command.add_argument("--ablations", type=whole(0, 100_000), default=None, help=few)
    return top


def main(arguments: list[str] | None = None) -> int:
    chosen = parser().parse_args(arguments)
    seed = secrets.randbelow(10**6) if chosen.seed is None else chosen.seed
    compared = chosen.cases // 5 if chosen.ablations is None else min(chosen.ablations, chosen.cases)
    try:
        # Small matrices: more threads of the linear algebra cost four times the processor time.
        with threadpool_limits(1):
            report = bench(chosen.cases, seed, compared, _progress)
    except InvalidValue as error:
        print(error, file=sys.stderr)
        return 2
    if chosen.json:
        print(json.dumps({"seed": seed, **report.as_dict()}, indent=1))
    else:
        _print(report, seed)
    return 0


def _progress(number: int, result: Result) -> None:
    if sys.stderr.isatty():
        print(f"\r{number + 1:5d} {result.verdict:22}", end="", file=sys.stderr, flush=True)


def _print(report: Report, seed: int) -> None:
    print(f"\nseed {seed}: utility {report.score['utility']:.3f}\n{HEADER}")
    for mark in report.score["marks"]:
        print(as_line(mark))
    for name, score in report.ablations.items():
        print(f"\n{name}, on {report.compared} cases: utility {score['utility']:.3f}")
        for mark in score["marks"]:
            if mark["mark"] is not None:
                print(as_line(mark))


if __name__ == "__main__":
    sys.exit(main())

"""`python -m worker.optimizer bench [--json] [--seeds 30] [--parallel 1] [--method auto]`: see bench.py."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable
from typing import NoReturn

from threadpoolctl import threadpool_limits

from worker.optimizer.bench import HEADER, Bench, as_line, bench, methods
from worker.optimizer.synthetic import NOISE_SD_DEG, SyntheticRig


class OneLineParser(argparse.ArgumentParser):
    """Says what is wrong in one line and exits with 2."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}\n")


def whole(lowest: int, highest: int) -> Callable[[str], int]:
    def parse(text: str) -> int:
        if not text.isdecimal() or not lowest <= int(text) <= highest:
            allowed = f"a whole number from {lowest} to {highest}"
            raise argparse.ArgumentTypeError(f"got {text!r}, allowed is {allowed}")
        return int(text)

    return parse


def _noise(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value <= 10.0:
        raise argparse.ArgumentTypeError(f"got {text!r}, allowed is 0 to 10 degrees")
    return value


def parser() -> OneLineParser:
    top = OneLineParser(prog="python -m worker.optimizer", description="The optimizer's own commands.")
    commands = top.add_subparsers(dest="command", required=True)
    command = commands.add_parser("bench", help="rank strategies on the synthetic study of calibration.md")
    command.add_argument("--json", action="store_true", help="a list of rows instead of the table")
    command.add_argument("--seeds", type=whole(1, 1000), default=30, help="studies for each case")
    command.add_argument("--first-seed", type=whole(0, 10**6), default=1, help="the first study's seed")
    command.add_argument("--noise", type=_noise, default=NOISE_SD_DEG, help="sd of a run, degrees")
    command.add_argument("--parallel", type=whole(1, 64), default=1, help="designs in flight")
    names = sorted(methods())
    command.add_argument("--method", action="append", choices=names, help="only this one (repeatable)")
    return top


def main(arguments: list[str] | None = None) -> int:
    chosen = parser().parse_args(arguments)
    options = Bench(chosen.seeds, chosen.first_seed, chosen.parallel, SyntheticRig(chosen.noise))
    # Small matrices: a second thread of the linear algebra only waits, and costs as much again. The rows come as
    # they are computed, so they are taken inside of the limit.
    with threadpool_limits(1):
        rows = bench(options, chosen.method)
        if chosen.json:
            print(json.dumps([row.as_dict() for row in rows], indent=1))
            return 0
        print(HEADER)
        for row in rows:
            print(as_line(row), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

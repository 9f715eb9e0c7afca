"""python -m demcore verify: the cases of physics.md section 3 against the core."""

from __future__ import annotations

import argparse
import json


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Its arguments."""
    check = commands.add_parser("verify", help="closed forms against the core")
    check.add_argument("--json", action="store_true", help="print a list of cases as JSON")
    check.add_argument("--slow", action="store_true", help="also the cases that take minutes each")
    check.set_defaults(run=verify)


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

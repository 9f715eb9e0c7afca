"""`make faults [SCHEDULES=200] [SEED=1] [BACKEND=sqlite|postgresql]`: random schedules of faults on real jobs.

Seeds are dealt to the databases in turn, which run at once; a schedule that fails prints the command that draws it
again.
"""

from __future__ import annotations

import argparse
import sys

from tests.faults.campaign import run_everywhere
from tests.faults.faults import WINDOW_S

BACKENDS = ("sqlite", "postgresql")


def say(text: str) -> None:
    print(text, flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--schedules", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--backend", choices=BACKENDS, action="append")
    parser.add_argument("--lease", type=float, default=10.0, help="seconds (default: the service's own, 10)")
    parser.add_argument("--window", type=float, default=WINDOW_S, help="seconds in which faults begin")
    wanted = parser.parse_args()
    backends = tuple(wanted.backend or BACKENDS)
    dealt = {
        backend: [wanted.seed + k for k in range(wanted.schedules) if k % len(backends) == index]
        for index, backend in enumerate(backends)
    }
    total, problems = run_everywhere(dealt, say, wanted.lease, wanted.window)
    for line in problems + total.lines(wanted.lease):
        say(line)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())

"""`make faults [SCHEDULES=200] [SEED=1] [BACKEND=sqlite|postgresql]`: random schedules of faults on real jobs.

Seeds are dealt to the databases in turn; a schedule that fails prints the command that draws it again.
"""

from __future__ import annotations

import argparse
import sys

from tests.faults.campaign import Total, run_campaign
from tests.faults.faults import WINDOW_S
from tests.faults.rig import running_rig

BACKENDS = ("sqlite", "postgresql")


def say(text: str) -> None:
    print(text, flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--schedules", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--backend", choices=BACKENDS, action="append")
    parser.add_argument("--lease", type=float, default=5.0, help="seconds")
    parser.add_argument("--window", type=float, default=WINDOW_S, help="seconds in which faults begin")
    wanted = parser.parse_args()
    backends = tuple(wanted.backend or BACKENDS)
    total, problems = Total(), list[str]()
    for index, backend in enumerate(backends):
        seeds = [wanted.seed + k for k in range(wanted.schedules) if k % len(backends) == index]
        if not seeds:
            continue
        with running_rig(backend, lease_s=wanted.lease) as rig:
            problems += run_campaign(rig, seeds, total, say, wanted.window)
    for line in problems + total.lines(wanted.lease):
        say(line)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())

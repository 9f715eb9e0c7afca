"""Ten random schedules of faults, five on each database; `make faults` runs as many as are wanted.

Both installations run at once, because most of a schedule is waiting: for a lease, for a process that starts.
"""

from __future__ import annotations

import random
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest

from tests.faults.campaign import Total, run_campaign
from tests.faults.rig import running_rig

SCHEDULES = 5
# Long enough for a beat to come through where everything runs on two cores that other tests use as well.
LEASE_S = 12.0
WINDOW_S = 3.0


def campaign(first_seed: int, backend: str) -> tuple[Total, list[str], list[str]]:
    """The sum of five schedules, what was said of each, and what was wrong."""
    total, said = Total(), list[str]()
    with running_rig(backend, lease_s=LEASE_S) as rig:
        seeds = range(first_seed, first_seed + SCHEDULES)
        problems = run_campaign(rig, list(seeds), total, said.append, WINDOW_S)
    return total, said + [f"{backend}: {line}" for line in total.lines(LEASE_S)], problems


# A minute and a half on two quiet cores.
@pytest.mark.timeout(1200)
def test_an_accepted_job_is_never_lost_and_never_done_twice(capsys: pytest.CaptureFixture[str]) -> None:
    """Other schedules in every run; one that fails says the command that draws it again."""
    first_seed = random.SystemRandom().randrange(10**6)
    with capsys.disabled():
        print(
            f"\n{SCHEDULES} schedules on each database: SEED={first_seed} LEASE={LEASE_S:g} WINDOW={WINDOW_S:g}"
        )
    with ThreadPoolExecutor(2) as pool:
        campaigns = list(pool.map(partial(campaign, first_seed), ("sqlite", "postgresql")))
    with capsys.disabled():
        print("", *(line for _, lines, _ in campaigns for line in lines), sep="\n")
    for total, lines, problems in campaigns:
        assert not problems, "\n".join(problems + lines)
        assert (total.schedules, total.lost, total.doubled, total.bits_equal) == (SCHEDULES, 0, 0, True)
        assert total.finished_once == total.accepted > SCHEDULES

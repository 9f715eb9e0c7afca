"""Ten random schedules of faults, five on each database; `make faults` runs as many as are wanted."""

from __future__ import annotations

import random

import pytest

from tests.faults.campaign import run_everywhere

SCHEDULES = 5
# Long enough for a beat to come through where everything runs on two cores that other tests use as well.
LEASE_S = 12.0
WINDOW_S = 3.0


# A minute and a half on two quiet cores.
@pytest.mark.timeout(1200)
def test_an_accepted_job_is_never_lost_and_never_done_twice(capsys: pytest.CaptureFixture[str]) -> None:
    """Other schedules in every run; one that fails says the command that draws it again."""
    first_seed = random.SystemRandom().randrange(10**6)
    with capsys.disabled():
        print(
            f"\n{SCHEDULES} schedules on each database: SEED={first_seed} LEASE={LEASE_S:g} WINDOW={WINDOW_S:g}"
        )
    said = list[str]()
    seeds = range(first_seed, first_seed + SCHEDULES)
    total, problems = run_everywhere({"sqlite": seeds, "postgresql": seeds}, said.append, LEASE_S, WINDOW_S)
    lines = said + total.lines(LEASE_S)
    with capsys.disabled():
        print("", *lines, sep="\n")
    assert not problems, "\n".join(problems + lines)
    assert (total.schedules, total.lost, total.doubled, total.bits_equal) == (2 * SCHEDULES, 0, 0, True)
    assert total.finished_once == total.accepted > 2 * SCHEDULES

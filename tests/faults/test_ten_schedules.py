"""Ten of the random schedules, five on each backend; `make faults` runs as many as are wanted."""

from __future__ import annotations

import pytest

from tests.faults.campaign import Total, run_campaign
from tests.faults.rig import running_rig

SCHEDULES = 5
LEASE_S = 4.0
WINDOW_S = 3.0


# Slow until its length on an idle machine is known: two installations start, with two workers each.
@pytest.mark.slow
@pytest.mark.parametrize(("backend", "first"), [("sqlite", 1001), ("postgresql", 2001)])
@pytest.mark.timeout(900)
def test_an_accepted_job_is_never_lost_and_never_done_twice(
    backend: str, first: int, capsys: pytest.CaptureFixture[str]
) -> None:
    total, said = Total(), list[str]()
    with running_rig(backend, lease_s=LEASE_S) as rig:
        problems = run_campaign(rig, list(range(first, first + SCHEDULES)), total, said.append, WINDOW_S)
    with capsys.disabled():
        print("\n" + "\n".join(said + total.lines(LEASE_S)))
    assert not problems, "\n".join(problems)
    assert (total.schedules, total.lost, total.doubled, total.bits_equal) == (SCHEDULES, 0, 0, True)
    assert total.finished_once == total.accepted > SCHEDULES

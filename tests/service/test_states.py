"""The table of allowed state changes."""

from __future__ import annotations

import pytest

from service.domain.states import (
    ALLOWED_CHANGES,
    ChangeNotAllowed,
    DesignState,
    JobState,
    StudyState,
    is_over,
    require_change,
    sources,
)


def test_every_state_is_in_the_table_and_leads_to_its_own_kind_only() -> None:
    for kind in (DesignState, JobState, StudyState):
        for state in kind:
            assert all(isinstance(target, kind) for target in ALLOWED_CHANGES[state])


def test_what_is_over_never_changes() -> None:
    over = {state for state in ALLOWED_CHANGES if is_over(state)}
    assert over == {
        *(DesignState.COMPLETE, DesignState.FAILED, DesignState.CANCELLED),
        *(JobState.DONE, JobState.FAILED, JobState.CANCELLED),
        *(StudyState.COMPLETED, StudyState.CANCELLED, StudyState.FAILED),
    }


def test_a_result_needs_a_running_design() -> None:
    assert sources(DesignState.COMPLETE) == (DesignState.RUNNING,)
    with pytest.raises(ChangeNotAllowed, match="WAITING cannot become COMPLETE"):
        require_change(DesignState.WAITING, DesignState.COMPLETE)


def test_only_a_queued_job_can_be_claimed() -> None:
    assert sources(JobState.RUNNING) == (JobState.QUEUED,)

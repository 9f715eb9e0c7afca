"""The states of designs, jobs and studies, and the one table of allowed changes for each.

Everything that changes a state asks here: SQL statements through `sources`, Python through `require_change`.
Plain enums and not texts: as texts a job's "running" would equal a study's, and be one key of the table.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum


class DesignState(Enum):
    """Where a simulation stands: a design (one parameter set of a study), or a charge."""

    WAITING = "WAITING"
    RUNNING = "RUNNING"
    COMPLETE = "COMPLETE"
    FAILED = "FAILED"
    CANCELLED = "CANCELLED"


class JobState(Enum):
    """Where a piece of work for a worker stands."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


class StudyState(Enum):
    """Where a study stands. FINISHING and CANCELLING propose nothing new and wait for what is in flight; PAUSED
    proposes and starts nothing until somebody resumes it, and lets what runs come to its end."""

    RUNNING = "running"
    PAUSED = "paused"
    FINISHING = "finishing"
    CANCELLING = "cancelling"
    COMPLETED = "completed"
    CANCELLED = "cancelled"
    FAILED = "failed"


class JobKind(Enum):
    """What a job does: propose the next design, simulate one, recommend the study's optimum at its end, report
    on what is known of a study so far, simulate a charge of the hopper, or diagnose a data set."""

    PROPOSE = "propose"
    SIMULATE = "simulate"
    RECOMMEND = "recommend"
    REPORT = "report"
    CHARGE = "charge"
    DIAGNOSE = "diagnose"


class Verdict(Enum):
    """What a finished design says about the objective."""

    FEASIBLE = "feasible"
    UNFEASIBLE = "unfeasible"
    ERROR = "error"


State = DesignState | JobState | StudyState

# RUNNING -> WAITING and running -> queued: the attempt was lost, given back, or is repeated by a retry rule.
ALLOWED_CHANGES: Mapping[State, frozenset[State]] = {
    DesignState.WAITING: frozenset({DesignState.RUNNING, DesignState.CANCELLED}),
    DesignState.RUNNING: frozenset(
        {DesignState.WAITING, DesignState.COMPLETE, DesignState.FAILED, DesignState.CANCELLED}
    ),
    DesignState.COMPLETE: frozenset(),
    DesignState.FAILED: frozenset(),
    DesignState.CANCELLED: frozenset(),
    JobState.QUEUED: frozenset({JobState.RUNNING, JobState.CANCELLED}),
    JobState.RUNNING: frozenset({JobState.QUEUED, JobState.DONE, JobState.FAILED, JobState.CANCELLED}),
    JobState.DONE: frozenset(),
    JobState.FAILED: frozenset(),
    JobState.CANCELLED: frozenset(),
    StudyState.RUNNING: frozenset(
        {StudyState.PAUSED, StudyState.FINISHING, StudyState.CANCELLING, StudyState.FAILED}
    ),
    StudyState.PAUSED: frozenset({StudyState.RUNNING, StudyState.CANCELLING, StudyState.FAILED}),
    # FINISHING -> RUNNING: more budget came before the recommendation was made, or the last results took the
    # reason to stop back.
    StudyState.FINISHING: frozenset(
        {StudyState.RUNNING, StudyState.CANCELLING, StudyState.COMPLETED, StudyState.FAILED}
    ),
    StudyState.CANCELLING: frozenset({StudyState.CANCELLED, StudyState.FAILED}),
    StudyState.COMPLETED: frozenset(),
    StudyState.CANCELLED: frozenset(),
    StudyState.FAILED: frozenset(),
}

OPEN_DESIGNS = (DesignState.WAITING, DesignState.RUNNING)
OPEN_JOBS = (JobState.QUEUED, JobState.RUNNING)


class ActionNotAllowed(RuntimeError):
    """Something that cannot be done in the state that a row is in; the text says why, for the user."""


class ChangeNotAllowed(ActionNotAllowed):
    """A state change that the table does not have."""

    def __init__(self, current: State, new: State) -> None:
        thing = type(current).__name__.removesuffix("State").lower()
        super().__init__(f"a {thing} that is {current.value} cannot become {new.value}")


def sources(new: State) -> tuple[State, ...]:
    """The states from which `new` may be entered."""
    return tuple(current for current, targets in ALLOWED_CHANGES.items() if new in targets)


def require_change(current: State, new: State) -> None:
    """Raise ChangeNotAllowed unless the table has `current` -> `new`."""
    if new not in ALLOWED_CHANGES[current]:
        raise ChangeNotAllowed(current, new)


def is_over(state: State) -> bool:
    """True where no change is left."""
    return not ALLOWED_CHANGES[state]

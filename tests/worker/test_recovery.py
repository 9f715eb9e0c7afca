"""Which failure follows from which error, and which may be repeated."""

from __future__ import annotations

import errno

import pytest
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from demcore.errors import BlowUp, NeverSettles, NoResult, SimulationError
from service.db.session import Database
from service.domain.outcome import Failure, FailureClass
from service.file_store import StoreAway
from worker.recovery import classify, persist, retry_of


@pytest.mark.parametrize(
    ("error", "failure_class"),
    [
        (BlowUp("particle 3 is no longer finite"), FailureClass.BLOW_UP),
        (NeverSettles("still moves"), FailureClass.NEVER_SETTLES),
        (NoResult("no pile"), FailureClass.NO_RESULT),
        (SimulationError("something new"), FailureClass.ERROR),
        (MemoryError(), FailureClass.OUT_OF_MEMORY),
        (ZeroDivisionError("float division by zero"), FailureClass.ERROR),
    ],
)
def test_failure_classes(error: Exception, failure_class: FailureClass) -> None:
    failure = classify(error)
    assert failure.failure_class is failure_class
    assert str(error) in failure.text
    assert failure.text


def test_a_blow_up_is_repeated_once_with_half_the_step() -> None:
    failure = Failure(FailureClass.BLOW_UP, "overlap")
    again = retry_of(failure, time_step_factor=1.0, attempts_left=0, pause_s=30.0)
    assert again is not None
    assert (again.time_step_factor, again.counts) == (0.5, False)
    assert retry_of(failure, time_step_factor=0.5, attempts_left=9, pause_s=30.0) is None


def test_want_of_memory_is_repeated_while_attempts_are_left() -> None:
    failure = Failure(FailureClass.OUT_OF_MEMORY, "")
    again = retry_of(failure, 1.0, attempts_left=1, pause_s=30.0)
    assert again is not None
    assert (again.time_step_factor, again.counts) == (None, True)
    assert retry_of(failure, 1.0, attempts_left=0, pause_s=30.0) is None


@pytest.mark.parametrize(
    "failure_class", [FailureClass.NEVER_SETTLES, FailureClass.NO_RESULT, FailureClass.ERROR]
)
def test_what_is_the_designs_own_answer_is_not_repeated(failure_class: FailureClass) -> None:
    assert retry_of(Failure(failure_class, ""), 1.0, attempts_left=2, pause_s=30.0) is None


@pytest.mark.parametrize(
    "error", [OSError(errno.ENOSPC, "No space left on device"), OSError(errno.EDQUOT, "quota")]
)
def test_a_full_disk_is_tried_again_after_a_pause_and_uses_up_no_attempt(error: OSError) -> None:
    wrapped = RuntimeError("checkpoint")
    wrapped.__cause__ = error
    for found in (classify(error), classify(wrapped)):
        assert found.failure_class is FailureClass.DISK_FULL
        again = retry_of(found, 1.0, attempts_left=0, pause_s=7.0)
        assert again is not None
        assert (again.pause_s, again.counts) == (7.0, False)


def test_a_store_of_files_that_is_away_is_waited_for() -> None:
    found = classify(StoreAway("s3://bucket cannot be used"))
    assert found == Failure(FailureClass.STORE_AWAY, "s3://bucket cannot be used")
    again = retry_of(found, 1.0, attempts_left=0, pause_s=7.0)
    assert again is not None
    assert (again.pause_s, again.counts) == (7.0, False)


def test_another_error_of_the_system_is_no_full_disk() -> None:
    assert classify(OSError(errno.EIO, "Input/output error")).failure_class is FailureClass.ERROR


def test_a_record_waits_for_a_database_that_is_away(
    sqlite_database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("worker.recovery.RECORD_PAUSE_S", 0.01)
    tries = list[int]()

    def write(_session: Session) -> bool:
        tries.append(1)
        if len(tries) < 4:
            raise OperationalError("update jobs", {}, Exception("connection refused"))
        return True

    assert persist(sqlite_database, write, patience_s=5.0)
    assert len(tries) == 4


def test_patience_ends(sqlite_database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("worker.recovery.RECORD_PAUSE_S", 0.01)

    def write(_session: Session) -> bool:
        raise OperationalError("update jobs", {}, Exception("connection refused"))

    with pytest.raises(OperationalError):
        persist(sqlite_database, write, patience_s=0.05)

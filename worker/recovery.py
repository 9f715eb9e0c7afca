"""What follows from a failed attempt (calibration.md, decision 3), and how a record survives an outage."""

from __future__ import annotations

import errno
from collections.abc import Callable

from sqlalchemy.exc import InterfaceError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from sqlalchemy.orm import Session
from tenacity import Retrying, retry_if_exception_type, stop_after_delay, wait_fixed

from demcore.errors import SimulationError
from service.db.session import Database
from service.domain.outcome import Failure, FailureClass
from service.file_store import StoreAway
from service.studies.give_back_job import Return

NO_ROOM = (errno.ENOSPC, errno.EDQUOT)

# The one repetition after a blow-up is made with this share of the time step.
HALF_STEP = 0.5

# A finished simulation is worth waiting for the database: the fence still decides whether it counts.
RECORD_PATIENCE_S = 120.0
RECORD_PAUSE_S = 0.5


def classify(error: Exception) -> Failure:
    """The failure class and text that are stored."""
    text = str(error) or type(error).__name__
    if is_disk_full(error):
        return Failure(FailureClass.DISK_FULL, f"no room on the worker's disk: {text}")
    if isinstance(error, StoreAway):
        return Failure(FailureClass.STORE_AWAY, text)
    if isinstance(error, MemoryError):
        return Failure(FailureClass.OUT_OF_MEMORY, text)
    if isinstance(error, SimulationError):
        known = error.kind in set(FailureClass)
        return Failure(FailureClass(error.kind) if known else FailureClass.ERROR, text)
    return Failure(FailureClass.ERROR, f"{type(error).__name__}: {text}")


def is_disk_full(error: BaseException | None) -> bool:
    """Whether a disk or a quota was full, in `error` or in what caused it."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in NO_ROOM:
            return True
        error = error.__cause__ or error.__context__
    return False


def retry_of(failure: Failure, time_step_factor: float, attempts_left: int, pause_s: float) -> Return | None:
    """The repetition that the rules allow, None when the failure is the answer.

    Out of memory: again, at most twice, like a lost worker. Blow-up: once, with half the time step. Disk full,
    or no way to the object store: from the last checkpoint, every `pause_s` seconds, until it is possible.
    """
    if failure.failure_class in (FailureClass.DISK_FULL, FailureClass.STORE_AWAY):
        return Return(failure.failure_class.value, failure.text, pause_s=pause_s)
    if failure.failure_class is FailureClass.OUT_OF_MEMORY and attempts_left > 0:
        return Return(failure.failure_class.value, failure.text, counts=True)
    if failure.failure_class is FailureClass.BLOW_UP and time_step_factor > HALF_STEP:
        return Return(failure.failure_class.value, failure.text, time_step_factor=HALF_STEP)
    return None


def persist(
    database: Database, write: Callable[[Session], bool], patience_s: float = RECORD_PATIENCE_S
) -> bool:
    """Run `write` in a transaction; while the database is away, again, until patience ends. False: fenced."""

    def record() -> bool:
        with database.writing() as session:
            return write(session)

    away = retry_if_exception_type((OperationalError, InterfaceError, PoolTimeout))
    pause = wait_fixed(RECORD_PAUSE_S)
    return Retrying(stop=stop_after_delay(patience_s), wait=pause, retry=away, reraise=True)(record)

"""What a worker process does around a job: keep its lease, hear of cancellation, stop in order.

A job's thread computes; a second thread beats. Both meet in `Attempt.stop`, which the simulation's progress
call reads several times a second. Beats write to the row that the API reads; a beat that finds the fence
closed means that another worker owns the job, and then nothing more is written.
"""

from __future__ import annotations

import mmap
import os
import threading
import time
import uuid
from collections.abc import Mapping
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import structlog
from sqlalchemy.exc import SQLAlchemyError

from service.db import queries
from service.db.queries import Lease
from service.db.session import Database

log = structlog.get_logger(__name__)

# Beats a lease: several may be lost or late before the lease is.
BEATS_PER_LEASE = 8


class StopReason(StrEnum):
    """Why an attempt must end early."""

    CANCELLED = "cancelled"
    FENCED = "fenced"
    SHUTDOWN = "shutdown"


class Shutdown:
    """A flag that a worker's main process raises and its forked children see: one byte of shared memory.

    Celery's main process gets the SIGTERM, waits for its children and tells them nothing.
    """

    def __init__(self) -> None:
        self._byte = mmap.mmap(-1, 1)
        self._parent = os.getppid()

    def announce(self) -> None:
        """Called in the main process."""
        self._byte[0] = 1

    def watch_parent(self) -> None:
        """Called in a child after the fork: from now on the death of the main process is a shutdown too."""
        self._parent = os.getppid()

    @property
    def is_on(self) -> bool:
        # A child whose parent was killed has a new one, and nobody would hand it another job.
        return self._byte[0] == 1 or os.getppid() != self._parent


shutdown = Shutdown()
worker_id = str(uuid.uuid4())


def renew_worker_id() -> str:
    """A new identity for this process, after a fork."""
    global worker_id
    worker_id = str(uuid.uuid4())
    return worker_id


AUTOGROUP = Path("/proc/self/autogroup")


def step_back(niceness: int) -> None:
    """This process, and what it forks, computes in what others leave of the cores.

    Where Linux groups processes by session, which `talus serve` gives each of its own, niceness counts within a
    group only, so the group steps back too.
    """
    os.nice(max(0, niceness - os.nice(0)))
    with suppress(OSError):
        AUTOGROUP.write_text(str(niceness))


class Attempt:
    """The time from claim to record: beats in a thread of its own from `with` to its end."""

    def __init__(self, database: Database, lease: Lease, lease_s: float) -> None:
        self._database = database
        self._lease = lease
        self._lease_s = lease_s
        self._progress: dict[str, Any] | None = None
        self._told: dict[str, Any] | None = None
        self._reason: StopReason | None = None
        self._extended = time.monotonic()
        self._is_beating = False
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._beat_until_done, name="heartbeat", daemon=True)

    @property
    def stop(self) -> StopReason | None:
        """None: go on. Read by the working thread."""
        if self._is_beating and time.monotonic() - self._extended > self._lease_s and self._reason is None:
            # A database behind a black hole gives no error: the beat waits for ever.
            self._lose("the database did not answer for a whole lease")
        if self._reason is None and shutdown.is_on:
            self._reason = StopReason.SHUTDOWN
        return self._reason

    def report(self, progress: Mapping[str, Any]) -> bool:
        """Store the newest progress for the next beat; False when the work must stop."""
        self._progress = dict(progress)
        return self.stop is None

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._done.set()
        self._thread.join()

    def _beat_until_done(self) -> None:
        while not self._done.wait(self._lease_s / BEATS_PER_LEASE):
            if self._beat() is False:
                return

    def _beat(self) -> bool:
        """False: the job is no longer ours."""
        progress = self._progress if self._progress != self._told else None
        self._is_beating = True
        try:
            with self._database.writing() as session:
                cancelled = queries.beat(session, self._lease, self._lease_s, progress)
        except SQLAlchemyError as error:
            return self._survive(error)
        finally:
            self._is_beating = False
        if cancelled is None:
            self._lose("another attempt owns the job")
            return False
        self._extended = time.monotonic()
        self._told = progress or self._told
        if cancelled and self._reason is None:
            self._reason = StopReason.CANCELLED
        return True

    def _survive(self, error: SQLAlchemyError) -> bool:
        """The database is away: go on for as long as the lease lasts by this machine's monotonic clock."""
        if time.monotonic() - self._extended < self._lease_s:
            return True
        self._lose(f"the database was away for a whole lease: {type(error).__name__}")
        return False

    def _lose(self, why: str) -> None:
        log.warning("lease lost", job=self._lease.job_id, attempt=self._lease.attempt, why=why)
        self._reason = StopReason.FENCED

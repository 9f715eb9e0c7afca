"""The dispatcher: tells the broker of queued jobs, and takes jobs from workers that vanished.

It runs as its own process. Any number may run: what two do at once is harmless, because a doubled message
finds its job claimed, and reaping is fenced.
"""

from __future__ import annotations

import os
import signal
import socket
import threading
import time
import uuid
from collections.abc import Callable, Sequence

import structlog
from sqlalchemy.exc import DBAPIError
from sqlalchemy.exc import TimeoutError as PoolTimeout

from service.db import queries
from service.db.presence import report_end, report_presence
from service.db.session import Database
from service.logs import configure_logs
from service.queue import BrokerAway, Publisher
from service.settings import Settings, get_settings
from service.studies.reap_job import reap_job

PASS_SECONDS = 0.2
REPORT_EVERY_S = 2.0

log = structlog.get_logger(__name__)


class Dispatcher:
    """One dispatcher's passes over the job table."""

    def __init__(self, database: Database, publisher: Publisher) -> None:
        self._database = database
        self._publisher = publisher
        self._id = str(uuid.uuid4())
        self._problem: str | None = None

    def publish(self) -> int:
        """Publish what needs a message, oldest first; the number published."""
        if not self._notice_loss():
            return 0
        with self._database.reading() as session:
            waiting = queries.to_publish(session)
        sent: list[str] = []
        try:
            for job_id, kind in waiting:
                self._publisher.publish(kind, job_id)
                sent.append(job_id)
                self._tell_broker(None)
        except BrokerAway as error:
            self._tell_broker(str(error))
        if sent:
            # After sending: a crash in between doubles a message, the other order would lose it for a while.
            with self._database.writing() as session:
                queries.mark_published(session, sent)
        return len(sent)

    def _notice_loss(self) -> bool:
        """After a restart or a FLUSHALL of the broker every queued job gets a new message; doubles are harmless.

        False: the broker is away.
        """
        try:
            keeps = self._publisher.keeps_messages()
        except BrokerAway as error:
            self._tell_broker(str(error))
            return False
        if not keeps:
            with self._database.writing() as session:
                jobs = queries.forget_publications(session)
            if jobs:
                log.warning("the broker lost its messages", jobs=jobs)
        return True

    def reap(self) -> int:
        """Take over every job whose lease ran out; the number taken."""
        with self._database.reading() as session:
            expired = queries.expired(session)
        taken = 0
        for lease in expired:
            with self._database.writing() as session:
                state = reap_job(session, lease)
            if state is not None:
                taken += 1
                log.warning("lease ran out", job=lease.job_id, attempt=lease.attempt, now=state.value)
        return taken

    def report(self) -> None:
        """Say that this dispatcher lives, and whether it reaches the broker."""
        try:
            self._publisher.check()
            self._tell_broker(None)
        except BrokerAway as error:
            self._tell_broker(str(error))
        with self._database.writing() as session:
            report_presence(session, self._id, "dispatcher", socket.gethostname(), os.getpid(), self._problem)

    def say_goodbye(self) -> None:
        """Take the presence back at an orderly end."""
        with self._database.writing() as session:
            report_end(session, self._id)

    def _tell_broker(self, problem: str | None) -> None:
        if (problem is None) != (self._problem is None):
            log.warning("broker away" if problem else "broker is back", problem=problem)
        self._problem = problem


def run_dispatcher(settings: Settings, stop: threading.Event) -> None:
    """Pass after pass until `stop` is set. A database or broker that is away is waited for.

    Publishing has a thread of its own: a broker that does not answer must not keep a dead worker's job from being
    noticed.
    """
    database = Database(settings.resolved_database_url)
    with Publisher(settings.resolved_broker_url) as publisher:
        dispatcher = Dispatcher(database, publisher)
        reports = Every(REPORT_EVERY_S, dispatcher.report)
        publishing = threading.Thread(
            target=_again_and_again, args=((dispatcher.publish, reports), stop), name="publish"
        )
        publishing.start()
        _again_and_again((dispatcher.reap,), stop)
        publishing.join()
        try:
            dispatcher.say_goodbye()
        except DBAPIError as error:
            log.warning("database away at the end", problem=str(error.orig))
    database.dispose()


class Every:
    """Calls `action` when it was not called for so many seconds."""

    def __init__(self, seconds: float, action: Callable[[], object]) -> None:
        self._seconds, self._action, self._due = seconds, action, 0.0

    def __call__(self) -> None:
        if time.monotonic() >= self._due:
            self._action()
            self._due = time.monotonic() + self._seconds


def _again_and_again(actions: Sequence[Callable[[], object]], stop: threading.Event) -> None:
    while not stop.is_set():
        try:
            for action in actions:
                action()
        except (DBAPIError, PoolTimeout) as error:
            log.warning("database away", problem=str(error))
            stop.wait(1.0)
        stop.wait(PASS_SECONDS)


def main() -> None:
    """`python -m service.dispatcher`: until SIGTERM or SIGINT."""
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda _number, _frame: stop.set())
    settings = get_settings()
    configure_logs(settings.log_level)
    run_dispatcher(settings, stop)


if __name__ == "__main__":
    main()

"""`talus serve`: starts every process of the service, brings back what dies, stops all of it cleanly.

One supervisor per data folder (a lock file says so), one thread, one loop. Each process leads a session of
its own, so that a Ctrl-C reaches the supervisor alone and a dead leader's children can be ended with it.
"""

from __future__ import annotations

import signal
import subprocess
import threading
import time
from collections.abc import Callable
from types import FrameType

import httpx

from service import broker
from service.child_process import Child, Say, end_all, last_line
from service.file_store import artifact_store
from service.first_key import first_key_lines
from service.installation_lock import check_port, only_one
from service.processes import ProcessSpec, broker_process, environment, long_running, migrate_command
from service.settings import Settings, StartupError

POLL_SECONDS = 0.1
BROKER_START_SECONDS = 10.0
API_START_SECONDS = 60.0
# Within 10 s of SIGTERM everything has ended: workers, API and dispatcher have 7 s, then the broker 2 s.
STOP_SECONDS = 7.0
BROKER_STOP_SECONDS = 2.0
LIVENESS_PATH = "/v1/health/live"


class Supervisor:
    """Starts, watches and stops the processes of one installation."""

    def __init__(self, settings: Settings, say: Say) -> None:
        self._settings = settings
        self._say = say
        self._stop = threading.Event()
        self._broker = Child(broker_process(settings), settings) if settings.embeds_broker else None
        self._api, *self._others = [Child(spec, settings) for spec in long_running(settings)]

    def run(self) -> None:
        """Until SIGTERM or SIGINT. Raises StartupError if the service cannot start."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_signal)
        with only_one(self._settings):
            check_port(self._settings)
            artifact_store(self._settings)  # a store without its package is told now, not by the first job
            self._settings.logs_dir.mkdir(exist_ok=True)
            try:
                self._start()
                while not self._stop.wait(POLL_SECONDS):
                    self._revive_all()
            finally:
                self._stop_all()

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self._stop.set()

    def _revive_all(self) -> None:
        for child in (self._broker, self._api, *self._others):
            if child is not None:
                child.revive(self._say)

    def _start(self) -> None:
        if self._broker is not None:
            broker.prepare_folders(self._settings)
            self._broker.start()
        self._wait_for(self._broker_answers, "the broker", BROKER_START_SECONDS, self._broker)
        if not self._stop.is_set():
            self._migrate()
            for child in (self._api, *self._others):
                child.start()
        self._wait_for(self._api_answers, "the API", API_START_SECONDS, self._api)
        if not self._stop.is_set():
            self._say(
                f"Talus is ready at {self._settings.base_url} (data and logs in {self._settings.data_dir})"
            )

    def _migrate(self) -> None:
        # Without a key: this log stays, and the first key is shown once, where the service was started.
        spec = ProcessSpec("migrate", (*migrate_command(), "--no-key"))
        log = self._settings.logs_dir / "migrate.log"
        with log.open("ab") as output:
            done = subprocess.run(
                spec.command, env=environment(self._settings, spec), stdout=output, stderr=output, check=False
            )
        if done.returncode:
            raise StartupError(
                f"the database could not be brought to the newest schema: {last_line(log)} ({log})"
            )
        for line in first_key_lines(self._settings):
            self._say(line)

    def _broker_answers(self) -> bool:
        return broker.is_up(self._settings.resolved_broker_url)

    def _api_answers(self) -> bool:
        try:
            return httpx.get(self._settings.base_url + LIVENESS_PATH, timeout=2.0).is_success
        except httpx.TransportError:
            return False

    def _wait_for(self, answers: Callable[[], bool], what: str, seconds: float, child: Child | None) -> None:
        """Until it answers or a signal comes; StartupError if its process ends or the time is over."""
        deadline = time.monotonic() + seconds
        while not self._stop.is_set() and not answers():
            dead = child is not None and not child.is_running()
            if dead or time.monotonic() > deadline:
                why = "ended at its start" if dead else f"did not answer within {seconds:g} s"
                raise StartupError(
                    f"{what} {why}" + (f": {last_line(child.log)} ({child.log})" if child else "")
                )
            self._stop.wait(0.05)

    def _stop_all(self) -> None:
        """Everything that uses the broker first, the broker last."""
        self._say("stopping")
        end_all([self._api, *self._others], STOP_SECONDS)
        if self._broker is not None:
            end_all([self._broker], BROKER_STOP_SECONDS)
        self._say("stopped")

"""The Celery application of the workers: `celery --app worker.app worker`.

The database is the truth: no result backend, no retries of Celery's, and a message is acknowledged before its
task runs, because a lost job comes back by its lease and not by the broker.
"""

from __future__ import annotations

import os
import socket
import threading
from typing import Any

import structlog
from celery import Celery
from celery.signals import worker_init, worker_process_init, worker_process_shutdown, worker_shutting_down
from sqlalchemy.exc import SQLAlchemyError

from service.db.presence import report_end, report_presence
from service.logs import configure_logs
from service.queue import BROKER_SETTINGS
from worker import installation, process
from worker.careful_transport import SteadyAMQP, use_careful_transport

log = structlog.get_logger(__name__)

PRESENCE_SECONDS = 5.0

configure_logs(installation.settings().log_level)
use_careful_transport()
app = Celery(
    "talus", broker=installation.settings().resolved_broker_url, include=["worker.tasks"], amqp=SteadyAMQP
)
app.conf.update(
    BROKER_SETTINGS,
    task_acks_late=False,
    worker_prefetch_multiplier=1,
    # A prefetched message waits behind a simulation of minutes while another worker has nothing to do.
    worker_disable_prefetch=True,
    # The message is only a hint, so a lost broker is no reason to stop a simulation.
    worker_cancel_long_running_tasks_on_connection_loss=False,
    broker_connection_retry_on_startup=True,
    broker_connection_max_retries=None,
    worker_hijack_root_logger=False,
    worker_send_task_events=False,
    # Nothing here uses it, and whoever can write to the broker could tell every worker to end.
    worker_enable_remote_control=False,
    enable_utc=True,
)


@worker_init.connect
def prepare(**_: Any) -> None:
    """Step back behind who answers, and call the kernels once before the children are forked: they then start
    without compiling."""
    # Here, because importing the kernels takes seconds that a Celery command like `report` need not wait.
    from worker.evaluate import compile_kernels as compile_now

    process.step_back(installation.settings().worker_niceness)
    compile_now()


@worker_shutting_down.connect
def announce_shutdown(**_: Any) -> None:
    """SIGTERM reached the main process: the children give their jobs back."""
    process.shutdown.announce()


@worker_process_init.connect
def begin_child(**_: Any) -> None:
    """A new identity, and a thread that says that this child lives."""
    process.renew_worker_id()
    process.shutdown.watch_parent()
    threading.Thread(target=_report_presence, name="presence", daemon=True).start()


@worker_process_shutdown.connect
def end_child(**_: Any) -> None:
    """Take the presence back."""
    try:
        with installation.database().writing() as session:
            report_end(session, process.worker_id)
    except SQLAlchemyError as error:
        log.warning("database away at the end", problem=type(error).__name__)


def _report_presence() -> None:
    pause = threading.Event()
    while not process.shutdown.is_on:
        try:
            with installation.database().writing() as session:
                report_presence(session, process.worker_id, "worker", socket.gethostname(), os.getpid())
        except SQLAlchemyError as error:
            log.warning("database away", problem=type(error).__name__)
        pause.wait(PRESENCE_SECONDS)

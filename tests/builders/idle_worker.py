"""A real Celery worker as production's, whose tasks do nothing and load no kernels.

`celery --app tests.builders.idle_worker worker`: for what a worker does around its tasks. Not to be imported by a
test: it changes its process for good.
"""

from __future__ import annotations

from celery.signals import worker_init

import worker.app
from service.queue import TASK_NAMES
from worker import careful_transport

app = worker.app.app
worker_init.disconnect(worker.app.prepare)
app.conf.include = ()
# Time for the tests, not for anything that they show.
careful_transport.ASK_AGAIN_S = 0.2


def do_nothing(_job_id: str) -> None:
    """What every task does here."""


for name in TASK_NAMES.values():
    app.task(name=name)(do_nothing)

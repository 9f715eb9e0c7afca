"""A real Celery worker whose piles are a formula, and whose simulations end only once a gate file exists.

`celery --app tests.builders.gated_worker worker`: everything but the simulation is what production runs. Not to
be imported by a test: it replaces the evaluator of its process for good.
"""

from __future__ import annotations

import time

from demcore.errors import Cancelled
from service.domain.outcome import PileMeasurement
from service.settings import Settings
from service.studies.claim_job import Claim
from tests.builders.work import GATE, Report, synthetic_pile
from worker import evaluate
from worker.app import app


def wait_at_the_gate(claim: Claim, report: Report, settings: Settings) -> PileMeasurement:
    while not (settings.data_dir / GATE).exists():
        if not report({"fraction": 0.5}):
            raise Cancelled("stopped on request")
        time.sleep(0.05)
    return synthetic_pile(claim, report, settings)


evaluate.evaluate = wait_at_the_gate
evaluate.compile_kernels = lambda: None

__all__ = ["app"]

"""Record a finished charge: results, files and state in one transaction."""

from __future__ import annotations

from sqlalchemy.orm import Session

from service.db.models import ChargeRow
from service.db.queries import Lease
from service.domain.outcome import ChargeMeasurement, RunCost
from service.domain.states import DesignState, JobState
from service.studies.close_run import close_run
from service.studies.finish_job import finish_job
from service.studies.keep_files import keep_files
from service.studies.move_task import move_task


def record_charge(
    session: Session, lease: Lease, measurement: ChargeMeasurement, cost: RunCost | None = None
) -> bool:
    """False: the lease was lost, nothing is written."""
    ended = finish_job(session, lease, JobState.DONE)
    if ended is None or not isinstance(ended.owner, ChargeRow):
        return False
    charge = ended.owner
    charge.results = dict(measurement.results)
    charge.code_version = cost.code_version if cost is not None else None
    keep_files(session, measurement.artifacts, charge_id=charge.id)
    move_task(session, charge, DesignState.COMPLETE)
    close_run(session, lease, "done", cost=cost)
    return True

"""Record a finished charge: results, files and state in one transaction."""

from __future__ import annotations

from sqlalchemy.orm import Session

from service.db.models import ArtifactRow, ChargeRow
from service.db.queries import Lease
from service.domain.outcome import ChargeMeasurement, RunCost
from service.domain.states import DesignState, JobState
from service.studies.close_run import close_run
from service.studies.finish_job import finish_job
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
    session.add_all(
        ArtifactRow(
            charge_id=charge.id,
            kind=artifact.kind,
            file_name=artifact.file_name,
            media_type=artifact.media_type,
            sha256=artifact.sha256,
            size_bytes=artifact.size_bytes,
            path=artifact.path,
        )
        for artifact in measurement.artifacts
    )
    move_task(session, charge, DesignState.COMPLETE)
    close_run(session, lease, "done", cost=cost)
    return True

"""Record a report on a study."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.models import ReportRow, RunRow
from service.db.queries import Lease
from service.domain.outcome import RunCost
from service.domain.states import JobState
from service.studies.close_run import close_run
from service.studies.finish_job import finish_job
from service.studies.record_event import record_event


def record_report(
    session: Session, lease: Lease, designs: int, content: Mapping[str, Any], cost: RunCost | None = None
) -> bool:
    """False: the lease was lost, nothing is written. `designs`: how many finished ones it was made from."""
    ended = finish_job(session, lease, JobState.DONE)
    if ended is None:
        return False
    close_run(session, lease, "done", cost=cost)
    version = cost.code_version if cost is not None else None
    study_id = ended.study.id
    # The hour of what it knows, not of its writing: a design that ended meanwhile is not in it.
    began = session.scalars(
        select(RunRow.started_at).where(RunRow.job_id == lease.job_id, RunRow.attempt == lease.attempt)
    ).one()
    report = ReportRow(
        study_id=study_id, designs=designs, code_version=version, content=dict(content), created_at=began
    )
    session.add(report)
    record_event(session, study_id, "report_written", {"study_id": study_id, "designs": designs})
    return True

"""Close the row of one attempt: how it ended and what it cost."""

from __future__ import annotations

from sqlalchemy import update
from sqlalchemy.orm import Session

from service.db.clock import database_now
from service.db.models import RunRow
from service.db.queries import Lease
from service.domain.outcome import RunCost


def close_run(
    session: Session, lease: Lease, exit_class: str, text: str | None = None, cost: RunCost | None = None
) -> None:
    """`exit_class`: done, cancelled, released, late, or a FailureClass."""
    cost = cost or RunCost()
    session.execute(
        update(RunRow)
        .where(RunRow.job_id == lease.job_id, RunRow.attempt == lease.attempt, RunRow.ended_at.is_(None))
        .values(
            ended_at=database_now(),
            exit_class=exit_class,
            exit_text=text,
            code_version=cost.code_version,
            time_step_s=cost.time_step_s,
            steps=cost.steps,
            wall_s=cost.wall_s,
            cpu_s=cost.cpu_s,
            memory_mb=cost.memory_mb,
        )
    )

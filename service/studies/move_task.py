"""Change the state of a charge or a diagnosis by the one table of allowed changes, with hour and reason."""

from __future__ import annotations

from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import TaskRow
from service.domain.outcome import Failure
from service.domain.states import DesignState, is_over, require_change


def move_task(session: Session, task: TaskRow, new: DesignState, failure: Failure | None = None) -> None:
    """Needs its lock. Raises ChangeNotAllowed."""
    require_change(task.state, new)
    task.state = new
    if new is DesignState.RUNNING and task.started_at is None:  # the first start of several attempts
        task.started_at = queries.now(session)
    if is_over(new):
        task.ended_at = queries.now(session)
    if failure is not None:
        task.failure_class, task.failure_text = failure.failure_class.value, failure.text

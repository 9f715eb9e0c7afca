"""Change a charge's state by the one table of allowed changes, with the hour and the reason."""

from __future__ import annotations

from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import ChargeRow
from service.domain.outcome import Failure
from service.domain.states import DesignState, is_over, require_change


def move_charge(
    session: Session, charge: ChargeRow, new: DesignState, failure: Failure | None = None
) -> None:
    """Needs the charge's lock. Raises ChangeNotAllowed."""
    require_change(charge.state, new)
    charge.state = new
    if new is DesignState.RUNNING:
        charge.started_at = queries.now(session)
    if is_over(new):
        charge.ended_at = queries.now(session)
    if failure is not None:
        charge.failure_class, charge.failure_text = failure.failure_class.value, failure.text

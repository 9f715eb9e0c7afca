"""Give a study more simulations, while it runs, is paused, or finishes because its budget is spent."""

from __future__ import annotations

from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import BudgetChangeRow, StudyRow
from service.domain.errors import InvalidValue
from service.domain.spec_record import spec_from_record
from service.domain.states import ActionNotAllowed, StudyState, require_change
from service.studies.advance_study import advance_study, next_number
from service.studies.record_event import record_study_event
from service.studies.withdraw_jobs import withdraw_decision


def extend_budget(session: Session, study_id: int, budget: int) -> StudyRow | None:
    """Set the budget to `budget`, which must be larger; the same again changes nothing. None: no such study.

    An open proposal is withdrawn, so that the next design is the first that knows of it: where the change came
    is stored, and with it the study can be repeated. Raises InvalidValue for a smaller budget, and
    ActionNotAllowed for a study that ends or has ended otherwise.
    """
    study = queries.lock_study(session, study_id)
    if study is None or study.budget == budget:
        return study
    is_spent = study.state is StudyState.FINISHING and study.stop_reason == "budget"
    if study.state not in (StudyState.RUNNING, StudyState.PAUSED) and not is_spent:
        raise ActionNotAllowed(
            f"study {study_id} is {study.state.value}: its budget can no longer be extended"
        )
    if budget < study.budget:
        raise InvalidValue("budget", budget, f"more than the present {study.budget}")
    spec = {**study.spec, "budget": budget}
    spec_from_record(spec)  # its limits are the same as a new study's
    session.add(
        BudgetChangeRow(
            study_id=study.id, number=next_number(session, study.id), before=study.budget, after=budget
        )
    )
    study.spec, study.budget = spec, budget
    withdraw_decision(session, study, "the budget was extended")
    if is_spent:
        require_change(study.state, StudyState.RUNNING)
        study.state = StudyState.RUNNING
        study.stop_reason = study.stop_text = study.stop_numbers = None
    record_study_event(session, study, "budget_extended")
    advance_study(session, study)
    return study

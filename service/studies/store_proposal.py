"""Keep what the optimizer was told and how it decided, beside the design or the stop that it answered."""

from __future__ import annotations

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from service.db.models import DesignRow, ProposalRow, StudyRow, SurrogateRow
from service.domain.history import ProposedDesign, StudyStop
from service.domain.spec_record import upgraded
from service.domain.states import DesignState
from service.studies.advance_study import last_seen


def store_proposal(
    session: Session, study: StudyRow, number: int, answer: ProposedDesign | StudyStop
) -> None:
    """Needs the study's lock; `number` is the design that the answer was asked for."""
    basis = max(0, last_seen(session, study, number))
    proposal = ProposalRow(
        study_id=study.id,
        number=number,
        basis=basis,
        pending=_count_pending(session, study.id, basis),
        seed=study.seed,
        strategy=str(upgraded(study.spec)["strategy"]),
    )
    if isinstance(answer, StudyStop):
        proposal.stop_reason = answer.reason
    else:
        proposal.chosen = number
        proposal.acquisition = answer.acquisition
        proposal.training_hash = answer.training_hash
        proposal.surrogate_id = _surrogate(session, study.id, answer)
    session.add(proposal)


def _count_pending(session: Session, study_id: int, basis: int) -> int:
    beyond = select(func.count()).where(
        DesignRow.study_id == study_id,
        DesignRow.number > basis,
        DesignRow.state != DesignState.CANCELLED,
        # Known before the study: whatever its number, the proposal saw it.
        DesignRow.origin != "import",
    )
    return int(session.scalar(beyond) or 0)


def _surrogate(session: Session, study_id: int, answer: ProposedDesign) -> int | None:
    """The id of the stored fit; the same training set asked again gives the same one."""
    if answer.hyperparameters is None or answer.training_hash is None:
        return None
    known = select(SurrogateRow.id).where(
        SurrogateRow.study_id == study_id, SurrogateRow.training_hash == answer.training_hash
    )
    stored = session.scalars(known).one_or_none()
    if stored is not None:
        return stored
    row = SurrogateRow(
        study_id=study_id,
        training_hash=answer.training_hash,
        hyperparameters=dict(answer.hyperparameters),
    )
    session.add(row)
    session.flush()
    return row.id

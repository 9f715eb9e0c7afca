"""Record what the optimizer answered: the next design with its simulate job, or that the study stops."""

from __future__ import annotations

from sqlalchemy.orm import Session

from service.db.models import DesignRow
from service.db.queries import Lease
from service.domain.history import ProposedDesign, StudyStop
from service.domain.outcome import RunCost
from service.domain.spec_record import design_hash, spec_from_record
from service.domain.states import DesignState, JobKind, JobState, StudyState, require_change
from service.studies.advance_study import add_job, advance_study, next_number
from service.studies.close_run import close_run
from service.studies.finish_job import FinishedJob, finish_job
from service.studies.pause_study import pause
from service.studies.record_event import record_design_event, record_study_event
from service.studies.store_proposal import store_proposal

# Reasons that a person can mend: the study waits for one instead of ending.
PAUSING = frozenset({"too_many_failures"})


def record_proposal(
    session: Session, lease: Lease, answer: ProposedDesign | StudyStop, cost: RunCost | None = None
) -> bool:
    """False: the lease was lost, nothing is written. A study that stopped meanwhile takes no new design."""
    ended = finish_job(session, lease, JobState.DONE)
    if ended is None:
        return False
    close_run(session, lease, "done", cost=cost)
    if ended.study.state is StudyState.RUNNING:
        # The fence makes this the number that the answer was computed for: whatever else numbers a design, or
        # changes what a proposal depends on, withdraws the open proposal first.
        number = next_number(session, ended.study.id)
        store_proposal(session, ended.study, number, answer)
        if isinstance(answer, StudyStop):
            _stop(session, ended, answer)
        else:
            _add_design(session, ended, answer, number)
    advance_study(session, ended.study)
    return True


def _stop(session: Session, ended: FinishedJob, stop: StudyStop) -> None:
    study = ended.study
    if stop.reason in PAUSING:
        pause(session, study, stop)
        return
    require_change(study.state, StudyState.FINISHING)
    study.state = StudyState.FINISHING
    study.stop_reason, study.stop_text, study.stop_numbers = stop.reason, stop.text, dict(stop.numbers)
    record_study_event(session, study, "study_stopping")


def _add_design(session: Session, ended: FinishedJob, proposal: ProposedDesign, number: int) -> None:
    study = ended.study
    spec = spec_from_record(study.spec)
    design = DesignRow(
        study_id=study.id,
        number=number,
        x=spec.space.as_dict(proposal.x),
        x_hash=design_hash(spec.parameters_of(proposal.x)),
        scale=proposal.scale,
        seed=proposal.seed,
        origin=proposal.origin,
        reason=proposal.reason,
        prediction=dict(proposal.prediction) if proposal.prediction is not None else None,
        acquisition=proposal.acquisition,
        state=DesignState.WAITING,
    )
    session.add(design)
    session.flush()
    add_job(session, study.id, JobKind.SIMULATE, design.id)
    record_design_event(session, design, "design_proposed")

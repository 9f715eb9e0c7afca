"""A study's history becomes its next design, or its recommendation: between rows and mathematics."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from service.domain.history import ProposedDesign, StudyHistory, StudyStop
from worker.optimizer.history import Design, History, Pending
from worker.optimizer.proposal import propose
from worker.optimizer.stopping import Stop, recommend


def next_design(history: StudyHistory) -> ProposedDesign | StudyStop:
    """The optimizer's answer for design `history.number`."""
    answer = propose(history.spec, _history(history), history.number)
    if isinstance(answer, Stop):
        return StudyStop(answer.reason, answer.text, dict(answer.numbers))
    return ProposedDesign(
        x=tuple(float(value) for value in answer.x),
        seed=int(answer.seed),
        origin=answer.origin,
        reason=answer.reason,
        prediction=None if answer.prediction is None else asdict(answer.prediction),
        acquisition=answer.acquisition,
        training_hash=answer.training_hash,
        hyperparameters=answer.hyperparameters,
    )


def recommendation(history: StudyHistory) -> dict[str, Any] | None:
    """The optimum with its figures and `x` by parameter; None when no design has an angle."""
    found = recommend(history.spec, _history(history))
    if found is None:
        return None
    return {**asdict(found), "x": history.spec.space.as_dict(found.x)}


def _history(history: StudyHistory) -> History:
    return History(
        finished=tuple(Design(d.number, d.x, d.seed, d.angle_deg, d.origin) for d in history.finished),
        pending=tuple(Pending(p.number, p.x, p.seed, p.origin) for p in history.pending),
    )

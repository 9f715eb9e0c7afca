"""A study's history becomes its next design, or its recommendation: between rows and mathematics."""

from __future__ import annotations

from typing import Any

from service.domain.history import FinishedDesign, ProposedDesign, StudyHistory, StudyStop
from service.domain.study import StudySpec
from worker.optimizer.history import Design, History, Pending, WarmStudy
from worker.optimizer.stopping import Stop, recommend
from worker.optimizer.strategies import BY_NAME


def next_design(history: StudyHistory) -> ProposedDesign | StudyStop:
    """The optimizer's answer for design `history.number`."""
    strategy = BY_NAME[history.spec.strategy]
    answer = strategy.propose(history.spec, _history(history), history.number)
    if isinstance(answer, Stop):
        return StudyStop(answer.reason, answer.text, dict(answer.numbers))
    return ProposedDesign(
        x=tuple(float(value) for value in answer.x),
        seed=int(answer.seed),
        origin=answer.origin,
        reason=answer.reason,
        scale=answer.scale,
        prediction=None if answer.prediction is None else answer.prediction.as_record(),
        acquisition=answer.acquisition,
        training_hash=answer.training_hash,
        hyperparameters=answer.hyperparameters,
    )


def recommendation(history: StudyHistory) -> dict[str, Any] | None:
    """The optimum with its figures and `x` by parameter; None when no design has an angle."""
    found = recommend(history.spec, _history(history))
    if found is None:
        return None
    return {**found.as_record(), "x": history.spec.space.as_dict(found.x)}


def whole_history(history: StudyHistory) -> History:
    """With every observable of the designs, not the responses alone: what a report is made of."""
    return _history(history, with_others=True)


def _history(history: StudyHistory, with_others: bool = False) -> History:
    spec = history.spec
    done = [_design(spec, d, with_others) for d in history.finished]
    waiting = [Pending(p.number, p.x, p.seed, p.origin, p.scale) for p in history.pending]
    return History(
        finished=tuple(d for d in done if d.scale == spec.scale),
        pending=tuple(p for p in waiting if p.scale == spec.scale),
        coarse=tuple(d for d in done if d.scale != spec.scale),
        coarse_pending=tuple(p for p in waiting if p.scale != spec.scale),
        warm=tuple(WarmStudy(w.study_id, tuple(_design(spec, d) for d in w.finished)) for w in history.warm),
        noise={
            r.observable: history.noise[r.observable] for r in spec.responses if r.observable in history.noise
        },
        accepted=history.accepted,
        replaced=history.replaced,
    )


def _design(spec: StudySpec, design: FinishedDesign, with_others: bool = False) -> Design:
    """A design that lacks one of the study's responses counts as failed; other observables are left out
    unless asked for."""
    found = design.results or {}
    asked = [r.observable for r in spec.responses]
    results = {name: found[name] for name in asked} if all(name in found for name in asked) else None
    if results is not None and with_others:
        results = dict(found)
    return Design(design.number, design.x, design.seed, results, design.origin, design.scale)

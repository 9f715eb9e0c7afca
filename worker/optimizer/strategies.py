"""The strategies that a study may name, behind one ask/tell interface.

A strategy is a pure function of (spec, history, number), as `proposal.propose` is; what it was told is the
history. The design to use is for all of them the emulator's, over all results; only `auto` spends replicates on
a certificate, but whoever has the seeds gets it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from service.domain.study import StudySpec
from worker.optimizer.design import X
from worker.optimizer.history import History
from worker.optimizer.plain_designs import REASONS, next_planned
from worker.optimizer.proposal import improve_surrogate, propose
from worker.optimizer.proposed import Proposal
from worker.optimizer.stopping import Stop, recommend


class Strategy(Protocol):
    """Ask for the next design, having told everything in `history`."""

    @property
    def name(self) -> str: ...

    def propose(self, spec: StudySpec, history: History, number: int) -> Proposal | Stop:
        """Design `number`, or why the study ends."""

    def recommend(self, spec: StudySpec, history: History) -> X | None:
        """The design to use; None before any result."""


@dataclass(frozen=True)
class Own:
    """A strategy of the service."""

    name: str
    ask: Callable[[StudySpec, History, int], Proposal | Stop]

    def propose(self, spec: StudySpec, history: History, number: int) -> Proposal | Stop:
        return self.ask(spec, history, number)

    def recommend(self, spec: StudySpec, history: History) -> X | None:
        best = recommend(spec, history)
        return best.x if best else None


BY_NAME: Mapping[str, Strategy] = {
    "auto": Own("auto", propose),
    "improve_surrogate": Own("improve_surrogate", improve_surrogate),
    **{name: Own(name, next_planned) for name in REASONS},
}

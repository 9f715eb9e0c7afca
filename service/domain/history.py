"""What the optimizer is told about a study, and what it answers, as plain records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from service.domain.observables import ANGLE, NoiseLevel
from service.domain.study import StudySpec

# What led to a design: the design of experiments, the surrogate, another seed of an earlier one, a person, a
# table with results, another study of the same test, the coarse prior.
ORIGINS = ("doe", "model", "replicate", "manual", "import", "warm", "coarse")


@dataclass(frozen=True)
class FinishedDesign:
    """A design with its results by observable; None where the simulation failed."""

    number: int
    x: tuple[float, ...]
    seed: int
    results: Mapping[str, float] | None
    origin: str
    scale: float

    @property
    def angle_deg(self) -> float | None:
        """None after an error."""
        return None if self.results is None else self.results.get(ANGLE)


@dataclass(frozen=True)
class PendingDesign:
    """A design whose result a proposal must not see."""

    number: int
    x: tuple[float, ...]
    seed: int
    origin: str
    scale: float


@dataclass(frozen=True)
class WarmHistory:
    """The finished designs of a stored study of the same test; their x in the order of *this* study's space."""

    study_id: int
    finished: tuple[FinishedDesign, ...]


@dataclass(frozen=True)
class StudyHistory:
    """What design `number` may be based on. For the recommendation: everything, with nothing pending.

    finished, pending: at the study's scale and at its coarse one, told apart by their `scale`. A row of a table
    with results is a finished design of origin `import`, which costs no budget, as coarse runs do not.
    warm: the studies that `spec.warm_start` names. noise: by observable, what earlier replicates of the same
    material, rig and scale scatter. accepted: the last design whose failure a person has seen before resuming a
    study that had paused for too many failures; up to it, failures do not pause the study again.
    replaced: designs that cost no budget and are not among the finished ones, because a repetition with the same
    seed took their place.
    """

    spec: StudySpec
    number: int
    finished: tuple[FinishedDesign, ...]
    pending: tuple[PendingDesign, ...]
    warm: tuple[WarmHistory, ...] = ()
    noise: Mapping[str, NoiseLevel] = field(default_factory=dict)
    accepted: int = 0
    replaced: int = 0


@dataclass(frozen=True)
class ProposedDesign:
    """The next design, with what led to it; stored whole, so that the proposal can be reproduced.

    `scale` is the study's own, or that of its coarse prior.
    """

    x: tuple[float, ...]
    seed: int
    origin: str
    reason: str
    scale: float
    prediction: Mapping[str, Any] | None = None
    acquisition: float | None = None
    training_hash: str | None = None
    hyperparameters: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class StudyStop:
    """Why a study proposes nothing more: a word, a sentence, and the numbers that decided."""

    reason: str
    text: str
    numbers: Mapping[str, Any]

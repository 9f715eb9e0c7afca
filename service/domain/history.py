"""What the optimizer is told about a study, and what it answers, as plain records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from service.domain.study import StudySpec


@dataclass(frozen=True)
class FinishedDesign:
    """A design with its angle; `angle_deg` None where the simulation failed."""

    number: int
    x: tuple[float, ...]
    seed: int
    angle_deg: float | None
    origin: str


@dataclass(frozen=True)
class PendingDesign:
    """A design whose result a proposal must not see."""

    number: int
    x: tuple[float, ...]
    seed: int
    origin: str


@dataclass(frozen=True)
class StudyHistory:
    """What design `number` may be based on. For the recommendation: everything, with nothing pending."""

    spec: StudySpec
    number: int
    finished: tuple[FinishedDesign, ...]
    pending: tuple[PendingDesign, ...]


@dataclass(frozen=True)
class ProposedDesign:
    """The next design, with what led to it; stored whole, so that the proposal can be reproduced."""

    x: tuple[float, ...]
    seed: int
    origin: str
    reason: str
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

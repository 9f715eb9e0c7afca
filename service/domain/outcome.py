"""What one attempt at a job gives back: a measured pile or charge, or a failure with its class and text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from service.domain.observables import read_observables
from service.domain.states import Verdict
from service.domain.study import Response


class FailureClass(StrEnum):
    """Why an attempt gave no result. The first five may be repeated, the others are the design's answer."""

    LOST = "lost"
    OUT_OF_MEMORY = "out_of_memory"
    DISK_FULL = "disk_full"
    STORE_AWAY = "store_away"
    BLOW_UP = "blow_up"
    NEVER_SETTLES = "never_settles"
    NO_RESULT = "no_result"
    ERROR = "error"


@dataclass(frozen=True)
class Failure:
    """A failure as it is stored: its class and a sentence."""

    failure_class: FailureClass
    text: str


@dataclass(frozen=True)
class StoredArtifact:
    """A file that already lies in the artifact store; `path` is relative to the store's folder."""

    kind: str
    file_name: str
    media_type: str
    sha256: str
    size_bytes: int
    path: str


@dataclass(frozen=True)
class PileMeasurement:
    """The numbers of a finished pile test. `angle_sd_deg` is the standard error over the base's sectors."""

    angle_deg: float
    angle_sd_deg: float | None
    literal_angle_deg: float | None
    results: Mapping[str, Any]
    artifacts: tuple[StoredArtifact, ...] = ()

    @property
    def observed(self) -> dict[str, float]:
        """By observable."""
        angles = {"angle_deg": self.angle_deg, "literal_angle_deg": self.literal_angle_deg}
        return read_observables({**self.results, **angles})


@dataclass(frozen=True)
class ChargeMeasurement:
    """The numbers of a finished charge, with its findings, and its files."""

    results: Mapping[str, Any]
    artifacts: tuple[StoredArtifact, ...] = ()


@dataclass(frozen=True)
class RunCost:
    """What an attempt used, for the `runs` table. None where it is not known."""

    code_version: str | None = None
    time_step_s: float | None = None
    steps: int | None = None
    wall_s: float | None = None
    cpu_s: float | None = None
    memory_mb: float | None = None
    details: Mapping[str, Any] = field(default_factory=dict)


def judge(responses: Sequence[Response], results: Mapping[str, float]) -> Verdict:
    """Feasible where every response lies in its window, ends included; an error where one was not measured."""
    if any(r.observable not in results for r in responses):
        return Verdict.ERROR
    inside = all(r.contains(results[r.observable]) for r in responses)
    return Verdict.FEASIBLE if inside else Verdict.UNFEASIBLE

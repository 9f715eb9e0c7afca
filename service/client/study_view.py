"""A study as its events tell it: one line per design, the best so far, the time left."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from service.client.rest import Event

# Designs that cost no budget and are another test's, or were known before: no best of this study is among them.
NOT_OF_THE_BUDGET = ("coarse", "import")


@dataclass
class DesignLine:
    """What is known of one design."""

    number: int
    x: Mapping[str, float]
    origin: str = ""
    state: str = "WAITING"
    angle_deg: float | None = None
    verdict: str | None = None
    failure: str | None = None
    fraction: float | None = None
    phase: str | None = None

    @property
    def is_over(self) -> bool:
        return self.state in ("COMPLETE", "FAILED", "CANCELLED")

    @property
    def is_of_the_budget(self) -> bool:
        return self.origin not in NOT_OF_THE_BUDGET


@dataclass
class StudyView:
    """Folds events into the present state. Times are the reader's own clock, in seconds."""

    target_deg: float
    budget: int
    parameters: tuple[str, ...]
    started: float
    designs: dict[int, DesignLine] = field(default_factory=dict)
    stop_reason: str | None = None
    stop_text: str | None = None
    state: str = "running"

    @classmethod
    def of(cls, study: Mapping[str, Any], now: float) -> StudyView:
        """From the answer to POST or GET /v1/studies."""
        spec = study["spec"]
        target = float(spec["responses"][0]["target"])
        return cls(target, int(study["budget"]), tuple(spec["variables"]), now)

    @property
    def finished(self) -> int:
        """Designs of the budget that are over."""
        return sum(line.is_over and line.is_of_the_budget for line in self.designs.values())

    @property
    def best(self) -> DesignLine | None:
        """The design of the budget whose angle is nearest to the target; the first of equals."""
        found = self.designs.values()
        seen = [line for line in found if line.angle_deg is not None and line.is_of_the_budget]
        return min(seen, key=lambda line: abs((line.angle_deg or 0.0) - self.target_deg), default=None)

    def seconds_left(self, now: float) -> float | None:
        """At most, if the budget is used up at the present pace; None before the first design is over."""
        if self.state != "running":
            return 0.0
        if not self.finished:
            return None
        return (now - self.started) / self.finished * max(self.budget - self.finished, 0)

    def fold(self, event: Event) -> DesignLine | None:
        """Takes the event in; the design that it was about, if any."""
        data = event.data
        if "number" in data:
            return self._fold_design(event)
        self.state = str(data.get("state", self.state))
        self.budget = int(data.get("budget", self.budget))
        self.stop_reason = data.get("stop_reason") or self.stop_reason
        self.stop_text = data.get("stop_text") or self.stop_text
        if event.kind == "study_goes_on":
            self.stop_reason = self.stop_text = None
        return None

    def _fold_design(self, event: Event) -> DesignLine | None:
        data = event.data
        number = int(data["number"])
        if event.kind == "progress":
            line = self.designs.get(number)
            if line is not None and not line.is_over:
                line.fraction, line.phase = data.get("fraction"), data.get("phase")
            return line
        line = self.designs.setdefault(number, DesignLine(number, data.get("x", {})))
        line.state = str(data.get("state", line.state))
        line.origin = str(data.get("origin", line.origin))
        line.angle_deg = data.get("angle_deg")
        line.verdict = data.get("verdict")
        line.failure = data.get("failure_class")
        if line.is_over or line.state == "WAITING":
            line.fraction = line.phase = None
        return line

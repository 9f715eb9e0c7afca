"""A proposed design and what was believed of it before it ran, as plain records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from worker.optimizer.design import X


@dataclass(frozen=True)
class Expected:
    """One response of a design before it ran; `sd` is inflated."""

    unit: str
    mean: float
    sd: float


@dataclass(frozen=True)
class Prediction:
    """What was believed of a design before it ran. `expected_miss` as `Outlook.miss` counts."""

    responses: Mapping[str, Expected]
    ok_probability: float
    window_probability: float
    expected_miss: float

    @property
    def primary(self) -> Expected:
        return next(iter(self.responses.values()))

    def as_record(self) -> dict[str, Any]:
        """JSON; the first response's figures under names that end with its unit."""
        first = self.primary
        miss = f"expected_miss_{first.unit}" if len(self.responses) == 1 else "expected_miss"
        return {
            f"mean_{first.unit}": first.mean,
            f"sd_{first.unit}": first.sd,
            "ok_probability": self.ok_probability,
            "window_probability": self.window_probability,
            miss: self.expected_miss,
            "responses": {
                name: {"unit": r.unit, "mean": r.mean, "sd": r.sd} for name, r in self.responses.items()
            },
        }


@dataclass(frozen=True)
class Proposal:
    """A design to run. `prediction`, `acquisition` and `hyperparameters` are None without a surrogate."""

    x: X
    seed: int
    origin: str
    prediction: Prediction | None
    acquisition: float | None
    reason: str
    training_hash: str
    hyperparameters: dict[str, Any] | None
    scale: float

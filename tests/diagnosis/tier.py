"""The analytic tier as `python -m worker.diagnosis bench` loads it: who hides and who scores."""

from __future__ import annotations

from tests.diagnosis.hider import cases, effect_free
from tests.diagnosis.scorer import score

__all__ = ["cases", "effect_free", "score"]

"""What a diagnosis costs: simulator runs, estimated before it starts and counted while it runs."""

from __future__ import annotations

from collections.abc import Sequence

from service.domain.data_set.records import Condition
from service.domain.effects import Library
from worker.diagnosis.fingerprints import BASELINE_SEEDS, MOST_REFINED, REFINED_SEEDS, SCREENING_SEEDS
from worker.diagnosis.null_calibration import BANK, POINTS
from worker.diagnosis.simulator import Outcomes, Parameter, Setting, Simulator


class Counted:
    """A simulator that counts its runs; otherwise the one that it was given."""

    def __init__(self, simulator: Simulator) -> None:
        self._simulator = simulator
        self.runs = 0

    @property
    def version(self) -> str:
        return self._simulator.version

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self._simulator.parameters

    def cannot(self, condition: Condition) -> str | None:
        return self._simulator.cannot(condition)

    def run(self, condition: Condition, settings: Sequence[Setting]) -> Outcomes:
        self.runs += len(settings)
        return self._simulator.run(condition, settings)


def estimated_runs(
    conditions: Sequence[Condition], known: Library, first_wave: int, second_wave: int
) -> dict[str, int]:
    """Runs of the training conditions by what they are for; at most, for the refined effects in any scope.

    Out of its scope an effect costs nothing; a stored null calibration of the same design saves its part.
    """
    trained = [c for c in conditions if not c.holdout]
    screened = sum(
        len(effect.keys) * SCREENING_SEEDS for effect in known.effects for c in trained if effect.acts_on(c)
    )
    directions = max((len(effect.keys) for effect in known.effects), default=1)
    count = len(trained)
    return {
        "emulator": count * (first_wave + second_wave),
        "screening": screened + count * BASELINE_SEEDS,
        "refinement": count * REFINED_SEEDS * (1 + MOST_REFINED * directions),
        "null": count * POINTS * BANK,
    }

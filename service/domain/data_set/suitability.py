"""What a data set is too thin for, in sentences: it is refused, or diagnosed with less to say.

Rule 2 of the design: the noise comes from replicates, at least three for each condition; rule 9: the gain comes
from conditions that were held out. Which cells are wrong is another matter (reading.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from service.domain.data_set.records import DataSet

LEAST_REPLICATES = 3
LEAST_CONDITIONS = 2
PLANNED = "Nothing is measured yet: ask what these tests could show (a plan), not for a diagnosis."


@dataclass(frozen=True)
class Suitability:
    """`usable`: the part that can be diagnosed, None where nothing can; the sentences say what is lost and why."""

    usable: DataSet | None
    sentences: tuple[str, ...]

    @property
    def is_refused(self) -> bool:
        return self.usable is None


def suitability(data_set: DataSet) -> Suitability:
    """Conditions with too few replicates are set aside; what is left is judged."""
    if not data_set.observations and not data_set.profiles:
        return Suitability(None, (PLANNED,))
    sentences = _ignored(data_set)
    replicates = data_set.replicates
    thin = [c for c in data_set.conditions if len(replicates[c.condition]) < LEAST_REPLICATES]
    sentences += [_set_aside([c.condition for c in thin])] if thin else []
    kept = data_set.restricted(c.condition for c in data_set.conditions if c not in thin)
    trained = kept.training.conditions
    if not trained:
        why = (
            "nothing can be said of any effect: no training condition has the replicates that tell the noise"
        )
        return Suitability(None, (*sentences, f"Refused, {why}."))
    if len({c.settings for c in trained}) < LEAST_CONDITIONS:
        return Suitability(None, (*sentences, _one_condition(trained[0].condition)))
    if not kept.held_out.conditions:
        sentences.append(
            "No held-out condition: the gain of an extended model could not be measured, so an effect can be "
            "named but not claimed; mark at least one condition with holdout = 1 before the analysis."
        )
    return Suitability(kept, tuple(sentences))


def _ignored(data_set: DataSet) -> list[str]:
    """Cells that nobody reads: somebody meant them."""
    by_column: dict[str, list[str]] = {}
    for c in data_set.conditions:
        for column in c.ignored:
            by_column.setdefault(column, []).append(c.condition)
    found = []
    for column, names in by_column.items():
        why = "their test has no such thing"
        if column == "lift_speed_m_s":
            why = "there the cylinder is removed at once; where it was lifted, write `lift` as removal"
        found.append(f"Not used: {column} of {', '.join(names)}: {why}.")
    return found


def _set_aside(names: Sequence[str]) -> str:
    listed = ", ".join(names)
    return (
        f"Set aside for fewer than {LEAST_REPLICATES} replicates: {listed}. Two runs do not tell how far runs "
        "scatter, and a misfit is only one against the scatter; repeat these conditions."
    )


def _one_condition(name: str) -> str:
    return (
        f"Refused, only one training condition ({name}): re-calibration can absorb what any effect would do "
        "there, so no effect could be told from another set of parameters; measure a second condition (mass, "
        "moisture, drop height or material)."
    )

"""A study of deflectors: designs are charged with every material, and each charge is written down at once.

A study that was stopped goes on with what its record lacks: what comes next depends on the lines alone, and not on
their order, so charges may run side by side.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from demcore.errors import InputError
from worker.deflector.designs import Space, first_designs
from worker.deflector.pareto import pareto_set
from worker.deflector.proposal import propose
from worker.deflector.record import Record
from worker.deflector.spread import Spread, one_by_one
from worker.optimizer.design import FloatArray

OBJECTIVES = ("variation_of_mass", "variation_of_size")
# Tells what a charge of this material over this device gives: summary by name. Arguments: u, material, seed.
Evaluate = Callable[[tuple[float, ...], str, int], Mapping[str, Any]]


@dataclass(frozen=True)
class StudyPlan:
    """How many designs, the first `initial` of them spread over the box; the present device comes before all.
    Every charge has the same `seed`: designs are compared under the same grains."""

    designs: int = 20
    initial: int = 12
    materials: tuple[str, ...] = ("coke", "iron")
    seed: int = 1

    def __post_init__(self) -> None:
        if not 3 <= self.initial <= self.designs <= 1000:
            raise InputError(
                "designs", [self.initial, self.designs], "3 or more at first, 1000 at most in all"
            )
        if not self.materials:
            raise InputError("materials", [], "at least one")


@dataclass(frozen=True)
class Tried:
    """A device with its objectives: means over the materials, apart in `by_material`. nan: a charge failed."""

    u: tuple[float, ...]
    objectives: tuple[float, ...]
    by_material: Mapping[str, Mapping[str, float]]

    @property
    def has_result(self) -> bool:
        return all(math.isfinite(v) for v in self.objectives)


def tried(rows: Sequence[Mapping[str, Any]], materials: Sequence[str]) -> list[Tried]:
    """The designs of a record that were charged with all materials, in the order of their numbers."""
    by_number: dict[int, dict[str, Mapping[str, Any]]] = {}
    for row in rows:
        by_number.setdefault(row["number"], {})[row["material"]] = row
    found = []
    for _, charges in sorted(by_number.items()):
        if set(charges) >= set(materials):
            values = {m: {name: charges[m][name] for name in OBJECTIVES} for m in materials}
            means = tuple(
                float(np.mean([_number(values[m][name]) for m in materials])) for name in OBJECTIVES
            )
            found.append(Tried(tuple(charges[materials[0]]["u"]), means, values))
    return found


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def run_study(
    space: Space,
    plan: StudyPlan,
    evaluate: Evaluate,
    record: Record,
    tell: Callable[[str], None] = lambda _: None,
    spread: Spread = one_by_one,
) -> list[Tried]:
    """Try designs until the plan is done; number 0 is the present device.

    The designs that are spread over the box wait for nobody; of the others each waits for all before it.
    """
    initial = [space.unit_of(space.plant.deflector), *first_designs(space, plan.seed, plan.initial)]
    _charge(dict(enumerate(initial)), plan, evaluate, record, tell, spread)
    for number in range(len(initial), plan.designs + 1):
        u = _next(space, record.rows, plan, number)
        _charge({number: u}, plan, evaluate, record, tell, spread)
    return tried(record.rows, plan.materials)


def _charge(
    designs: Mapping[int, tuple[float, ...]],
    plan: StudyPlan,
    evaluate: Evaluate,
    record: Record,
    tell: Callable[[str], None],
    spread: Spread,
) -> None:
    """Every material over these designs, by number, but for what the record holds."""
    missing = [
        (number, material)
        for number in designs
        for material in plan.materials
        if not record.find({"number": number, "material": material})
    ]
    calls = [(designs[number], material, plan.seed) for number, material in missing]
    for k, summary in spread(evaluate, calls):
        number, material = missing[k]
        values = {name: _plain(summary.get(name)) for name in OBJECTIVES}
        record.add({"number": number, "material": material, "u": list(designs[number]), **values})
        tell(f"design {number}, {material}: " + ", ".join(f"{name} {v}" for name, v in values.items()))


def _plain(value: Any) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None


def _next(space: Space, rows: Sequence[Mapping[str, Any]], plan: StudyPlan, number: int) -> tuple[float, ...]:
    done = [t for t in tried(rows, plan.materials)[:number] if t.has_result]
    if len(done) < 2:
        raise InputError("designs", len(done), "at least two whose charges came to an end")
    u, f = arrays_of(done)
    return propose(space, u, f, plan.seed, number)


def arrays_of(designs: Sequence[Tried]) -> tuple[FloatArray, FloatArray]:
    """u (N, V) and objectives (N, M)."""
    return np.array([t.u for t in designs]), np.array([t.objectives for t in designs])


def front_of(designs: Sequence[Tried]) -> list[int]:
    """The Pareto set among those with results, as positions in `designs`."""
    there = [k for k, t in enumerate(designs) if t.has_result]
    return [there[k] for k in pareto_set(arrays_of([designs[k] for k in there])[1])] if there else []

"""The present device against a chosen one: fresh seeds, another scale, every material."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from demcore.experiments.charge_comparison import Row, compare
from demcore.plant.parts import Plant
from worker.deflector.record import Record
from worker.deflector.spread import Spread, one_by_one
from worker.deflector.study import OBJECTIVES

# None that a study used.
FIRST_FRESH_SEED = 1001
# Mass over time, the most of a summary: no number of a comparison.
NOT_KEPT = "account"
# Gives a charge's summary as plain JSON. Arguments: plant, material, scale, seed.
Charged = Callable[[Plant, str, float, int], dict[str, Any]]


@dataclass(frozen=True)
class Confirmation:
    """What is charged: `seeds` fresh ones of each material at `scale`."""

    materials: tuple[str, ...]
    scale: float
    seeds: int = 3


def confirm(
    plants: Mapping[str, Plant],
    plan: Confirmation,
    charge: Charged,
    record: Record,
    device: Sequence[float],
    spread: Spread = one_by_one,
) -> dict[str, list[Row]]:
    """All numbers of both devices, by material.

    `plants`: by the names that the rows get, `chosen` one of them; `device` stands for that in the record.
    """
    wanted: list[dict[str, Any]] = [
        {
            "device": list(device) if name == "chosen" else name,
            "material": material,
            "scale": plan.scale,
            "seed": FIRST_FRESH_SEED + k,
        }
        for material in plan.materials
        for k in range(plan.seeds)
        for name in plants
    ]
    missing = [key for key in wanted if record.find(key) is None]
    calls = [(plants[_name(key)], key["material"], plan.scale, key["seed"]) for key in missing]
    for k, summary in spread(charge, calls):
        kept = {name: value for name, value in summary.items() if name != NOT_KEPT}
        record.add({**missing[k], "summary": kept})
    found: dict[str, dict[str, list[dict[str, Any]]]] = {m: {n: [] for n in plants} for m in plan.materials}
    for key in wanted:
        row = record.find(key)
        assert row is not None
        found[key["material"]][_name(key)].append(row["summary"])
    return {material: compare(groups) for material, groups in found.items()}


def _name(key: Mapping[str, Any]) -> str:
    """Of the device of a row: the chosen one is written down by its variables."""
    return key["device"] if isinstance(key["device"], str) else "chosen"


def sentences(material: str, rows: Sequence[Row], plan: Confirmation) -> list[str]:
    """A line for each objective, and for whatever else stands out."""
    return [
        f"{material}, {row.name}: "
        + ", ".join(f"{name} {group.mean:.3f} +- {group.sd:.3f}" for name, group in row.groups.items())
        + f" ({plan.seeds} fresh seeds at scale {plan.scale:g})"
        for row in rows
        if row.name in OBJECTIVES or row.stands_out
    ]


def as_records(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """For JSON."""
    return [
        row._asdict() | {"groups": {name: group._asdict() for name, group in row.groups.items()}}
        for row in rows
    ]

"""The effects of a model version as a simulation takes them, and those of a version that extends another.

An effect of a version is a record: value, unit and ci90 of its amplitude, and of one that has a direction `along`,
its amplitude by effect key.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from service.domain.effects import library

ALONG = "along"
Effect = Mapping[str, Any]


def amplitudes_of(name: str, effect: Effect) -> Mapping[str, float] | None:
    """Of one effect by key; None for a direction that was not kept, as versions did not at first."""
    known = library()
    if name in known and known[name].directions_deg:
        found: Mapping[str, float] | None = effect.get(ALONG)
        return found
    return {name: float(effect["value"])}


def extended(parent: Mapping[str, Effect], found: Mapping[str, Effect]) -> dict[str, dict[str, Any]]:
    """The parent's effects with those found on top of them, the amplitude of one that both have is the sum.

    Its interval is as wide as the one found: the parent's amplitude was held while it was looked for.
    """
    joined = {name: dict(effect) for name, effect in parent.items()}
    for name, effect in found.items():
        joined[name] = _sum(parent[name], effect) if name in parent else dict(effect)
    return joined


def _sum(before: Effect, found: Effect) -> dict[str, Any]:
    moved, ends = float(found["value"]), found["ci90"]
    if ALONG not in found:
        value = float(before["value"]) + moved
        return {**found, "value": value, "ci90": [value - moved + end for end in ends]}
    along = {key: before[ALONG].get(key, 0.0) + part for key, part in found[ALONG].items()}
    value = math.hypot(*along.values())
    return {
        **found,
        "value": value,
        "ci90": [max(value - moved + end, 0.0) for end in ends],
        ALONG: along,
    }

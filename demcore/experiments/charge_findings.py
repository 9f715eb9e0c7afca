"""What the paper's authors saw in the plant beside what a charge shows (section 3.2). Importable without numba."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

# Piles have similar heights when they differ by less than this share of the higher one.
SIMILAR = 0.1
SHADOWS = frozenset({"under the deflector", "behind the rod"})


@dataclass(frozen=True)
class Finding:
    """One thing that the plant saw, what the charge shows of it, and whether they agree; None: cannot be said."""

    name: str
    plant: str
    here: str
    agrees: bool | None


def compare_findings(summary: Mapping[str, Any]) -> list[Finding]:
    """The paper's four findings beside the numbers of a charge's summary (ChargeResult.summary with findings)."""
    f, causes = summary["findings"], summary["findings"]["depressions"]
    both = f["near_height_m"] is not None and f["far_height_m"] is not None
    return [
        Finding("Piles", "two, near and far", f"{f['piles']}", f["piles"] == 2 and both),
        _heights(summary, both),
        Finding(
            "Depressions",
            " and ".join(sorted(SHADOWS, reverse=True)),
            ", ".join(causes) or "none",
            set(causes) >= SHADOWS,
        ),
        _sizes(summary, f["near_size_m"], f["far_size_m"]),
    ]


def _heights(summary: Mapping[str, Any], both: bool) -> Finding:
    near, far = summary["findings"]["near_height_m"], summary["findings"]["far_height_m"]
    told = "only one side has a pile"
    if both:
        told = f"far {far:.2f} m, near {near:.2f} m above the seat ({far - near:+.2f} m)"
    if summary["inputs"]["charge"]["name"] == "coke":
        return Finding("Their heights", "the far pile is much higher", told, far > near if both else None)
    similar = abs(far - near) < SIMILAR * max(far, near) if both else None
    return Finding("Their heights", "the piles have similar heights", told, similar)


def _sizes(summary: Mapping[str, Any], near: float | None, far: float | None) -> Finding:
    plant, larger = "larger grains in the far pile, smaller in the near one", None
    told = "only one side has a pile" + _by_side(summary)
    if near is not None and far is not None:
        on_belt = summary["belt"]["stratification"]
        known = on_belt is not None and math.isfinite(on_belt)
        told = f"far {1e3 * far:.0f} mm, near {1e3 * near:.0f} mm"
        told += f"; height and size on the belt correlate by {on_belt:.2f}" if known else ""
        larger = far > near
    return Finding("Segregation", plant, told, larger)


def _by_side(summary: Mapping[str, Any]) -> str:
    """Heaps or not: the grains of the two sides. Empty for a summary from before these were told."""
    near, far = (summary.get(f"{side}_side_size_m") for side in ("near", "far"))
    if near is None or far is None or not (math.isfinite(near) and math.isfinite(far)):
        return ""
    return f"; grains on the far side {1e3 * far:.0f} mm, on the near one {1e3 * near:.0f} mm"


def agreement(summaries: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, int]]:
    """Of several charges of one material: name of each finding, what the plant saw, and in how many they agree."""
    found = [compare_findings(summary) for summary in summaries]
    return [
        (same[0].name, same[0].plant, sum(finding.agrees is True for finding in same))
        for same in zip(*found, strict=True)
    ]

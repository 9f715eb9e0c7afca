"""What a pile test measures, by name: what a study may aim at, and where a design's results hold it.

A name carries its unit. Values are floats in that unit; a missing or not finite one is no measurement.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from service.domain.errors import InvalidValue


@dataclass(frozen=True)
class Observable:
    """One measured number. `lowest` to `highest` is what a target may be; `key` is its name in the results.

    `noise_sd`: the between-run sd that is expected before any replicate has run; None where it depends on the
    rig so much that only replicates can tell.
    """

    unit: str
    meaning: str
    lowest: float
    highest: float
    key: str
    noise_sd: float | None = None

    def read(self, results: Mapping[str, Any]) -> float | None:
        """The value in a design's results; None where it is missing or no finite number."""
        value = results.get(self.key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            return None
        return float(value)


ANGLE = "angle_deg"

# A pile of dry grains is flat at 0 and a wall at 90; the scanned angle lies between 15 and 45 for spheres
# (physics.md section 5), and a target outside 5 to 60 is a slip of the pen rather than a material. The noise of
# the scanned angle is calibration.md's (the paper's repeats pool to 0.58 deg); the literal reading scatters
# twice as much.
OBSERVABLES: Mapping[str, Observable] = {
    ANGLE: Observable("deg", "repose angle of the scanned surface", 5.0, 60.0, "angle_deg", 0.5),
    "literal_angle_deg": Observable(
        "deg", "repose angle by the paper's literal reading", 5.0, 60.0, "literal_angle_deg", 1.0
    ),
    "mass_on_base_kg": Observable("kg", "mass that stays on the base", 1e-6, 1e4, "mass_on_base_kg"),
    "discharge_t90_s": Observable(
        "s", "time until 90 % of what leaves the base has left", 1e-3, 1e3, "discharge_t90_s"
    ),
    "heap_height_m": Observable(
        "m", "height of the heap's highest point over the base", 1e-4, 10.0, "apex_height_m"
    ),
    "heap_top_m": Observable(
        "m", "mean height of the surface within .15 of the base's radius", 1e-4, 10.0, "heap_top_m"
    ),
    "share_on_base": Observable(
        "1", "mass that stays on the base over the mass filled", 1e-4, 1.0, "share_on_base"
    ),
    "discharge_t50_s": Observable(
        "s", "time until half of what leaves the base has left", 1e-3, 1e3, "discharge_t50_s"
    ),
    "filled_bulk_density_kg_m3": Observable(
        "kg/m3", "bulk density of the settled column", 1.0, 3e4, "filled_bulk_density_kg_m3"
    ),
    "fill_height_m": Observable(
        "m", "height of the settled column before the cylinder goes", 1e-4, 10.0, "fill_height_m"
    ),
}


@dataclass(frozen=True)
class NoiseLevel:
    """Between-run sd of one observable, pooled over `freedom` degrees of freedom of replicates."""

    sd: float
    freedom: int

    def __post_init__(self) -> None:
        if not (math.isfinite(self.sd) and self.sd >= 0.0):
            raise InvalidValue("noise.sd", self.sd, "a finite number of at least 0")
        if isinstance(self.freedom, bool) or self.freedom < 1:
            raise InvalidValue("noise.freedom", self.freedom, "a whole number of at least 1")


def read_observables(results: Mapping[str, Any]) -> dict[str, float]:
    """Every observable that a design's results hold, by observable name."""
    found = {name: observable.read(results) for name, observable in OBSERVABLES.items()}
    return {name: value for name, value in found.items() if value is not None}

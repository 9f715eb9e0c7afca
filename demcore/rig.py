"""The pile-test rigs: a filled cylinder standing on a round base. Importable without numba."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from importlib.resources import files

from demcore.errors import InputError


@dataclass(frozen=True)
class Rig:
    """Dimensions in metres, and the sectors of the paper's literal angle reading (its Tables 2 and 4)."""

    name: str
    base_diameter: float
    cylinder_diameter: float
    cylinder_height: float
    circular_sectors: int
    radial_sectors: int

    def __post_init__(self) -> None:
        for field in ("base_diameter", "cylinder_diameter", "cylinder_height"):
            if not 0.01 <= getattr(self, field) <= 100.0:
                raise InputError(f"rig.{field}", getattr(self, field), "0.01 to 100 m")
        if self.cylinder_diameter >= self.base_diameter:
            raise InputError("rig.cylinder_diameter", self.cylinder_diameter, "smaller than the base")

    @property
    def base_radius(self) -> float:
        return self.base_diameter / 2.0

    @property
    def cylinder_radius(self) -> float:
        return self.cylinder_diameter / 2.0


# Fewer mean diameters than this along the base's radius, and the angle feels the particles (physics.md section 4).
FEWEST_DIAMETERS = 12.0


def coarsest_scale(rig: Rig, mean_diameter: float) -> float:
    """The largest coarse-graining factor, to one decimal, that keeps FEWEST_DIAMETERS along the base's radius."""
    return math.floor(10.0 * rig.base_radius / (FEWEST_DIAMETERS * mean_diameter)) / 10.0


def _table() -> dict[str, dict[str, float]]:
    text = files("demcore").joinpath("data/rigs.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def rig_names() -> tuple[str, ...]:
    return tuple(_table())


def load_rig(name: str) -> Rig:
    """The rig shipped under `name`. Raises InputError for an unknown one."""
    table = _table()
    if name not in table:
        raise InputError("rig", name, "one of " + ", ".join(table))
    row = table[name]
    return Rig(
        name,
        row["base_diameter_m"],
        row["cylinder_diameter_m"],
        row["cylinder_height_m"],
        int(row["circular_sectors"]),
        int(row["radial_sectors"]),
    )

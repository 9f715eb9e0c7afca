"""The tables of a measured data set: which columns there are, in which unit, and what a cell may hold.

Names are those of the design of the diagnosis. Every number is kept in the unit that its name carries; an empty
cell of `conditions.csv` is the default given here, or None where the default is the material's own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

CONDITIONS, OBSERVATIONS, PROFILES = "conditions.csv", "observations.csv", "profiles.csv"
TESTS = ("pile", "charge")
REMOVALS = ("instant", "lift")
SECTORS = 24


@dataclass(frozen=True)
class Quantity:
    """A number with its unit, the range outside of which it is a slip of the pen, and an empty cell's default.

    `above_zero`: the lower end itself is not allowed.
    """

    unit: str
    lowest: float
    highest: float
    default: float | None = None
    above_zero: bool = False

    def allows(self, value: float) -> bool:
        inside = math.isfinite(value) and self.lowest <= value <= self.highest
        return inside and (value > 0.0 or not self.above_zero)

    @property
    def allowed(self) -> str:
        lower = "above 0" if self.above_zero else f"{self.lowest:g}"
        return f"{lower} to {self.highest:g} {self.unit}".rstrip()


def _positive(unit: str, highest: float, default: float | None = None) -> Quantity:
    return Quantity(unit, 0.0, highest, default, above_zero=True)


NUMBERS_OF_A_CONDITION: Mapping[str, Quantity] = {
    "mass_kg": _positive("kg", 1e6),
    "particle_density_kg_m3": _positive("kg/m^3", 3e4),
    "moisture_percent": Quantity("percent", 0.0, 40.0, 0.0),
    "base_diameter_m": _positive("m", 20.0),
    "cylinder_diameter_m": _positive("m", 20.0),
    "cylinder_height_m": _positive("m", 20.0),
    "lift_speed_m_s": _positive("m/s", 5.0, 0.1),
    "drop_height_m": Quantity("m", 0.0, 50.0, 0.0),
    "belt_speed_m_s": _positive("m/s", 10.0, 1.79),
    "belt_tilt_deg": Quantity("deg", -30.0, 30.0, 4.0),
    "feed_rate_kg_s": _positive("kg/s", 3000.0, 41.7),
    "deflector_near_pitch_deg": Quantity("deg", 0.0, 89.0, 45.0),
    "deflector_far_pitch_deg": Quantity("deg", 0.0, 89.0, 45.0),
    "deflector_ridge_across_m": Quantity("m", -5.0, 5.0, -0.18),
    "deflector_ridge_height_m": Quantity("m", -5.0, 5.0, -0.1),
    "deflector_rotation_deg": Quantity("deg", -180.0, 180.0, 0.0),
}
CHARGE_ONLY = tuple(
    name for name in NUMBERS_OF_A_CONDITION if name.startswith(("belt_", "feed_", "deflector_"))
)
# Of a pile alone; what either test has is in neither.
PILE_ONLY = ("removal", "lift_speed_m_s", "base_diameter_m", "cylinder_diameter_m", "cylinder_height_m")
NOT_OF: Mapping[str, tuple[str, ...]] = {"pile": CHARGE_ONLY, "charge": PILE_ONLY}
TEXTS_OF_A_CONDITION = ("condition", "test", "material", "psd", "removal", "holdout")
CONDITION_COLUMNS = (*TEXTS_OF_A_CONDITION, *NUMBERS_OF_A_CONDITION)
REQUIRED_OF_A_CONDITION = ("condition", "test", "material", "mass_kg")

OBSERVATION_COLUMNS = ("condition", "replicate", "observable", "value", "unit", "sensor_sd")
REQUIRED_OF_AN_OBSERVATION = ("condition", "replicate", "observable", "value", "unit")

PROFILE_NUMBERS: Mapping[str, Quantity] = {
    "theta_deg": Quantity("deg", -360.0, 360.0),
    "r_m": Quantity("m", 0.0, 20.0),
    "h_m": Quantity("m", -1.0, 20.0),
}
PROFILE_COLUMNS = ("condition", "replicate", *PROFILE_NUMBERS)


def _height() -> Quantity:
    # A scanner's zero may be off by some centimetres, so that a bare base reads below it.
    return Quantity("m", -1.0, 20.0)


PILE_OBSERVABLES: Mapping[str, Quantity] = {
    "repose_angle_deg": Quantity("deg", 0.0, 90.0, above_zero=True),
    "apex_height_m": _positive("m", 20.0),
    "mass_on_base_kg": _positive("kg", 1e6),
    "discharge_t90_s": _positive("s", 1e5),
    "bulk_density_kg_m3": _positive("kg/m^3", 3e4),
    "heap_offset_x_m": Quantity("m", -10.0, 10.0),
    "heap_offset_y_m": Quantity("m", -10.0, 10.0),
    "d50_on_base_m": _positive("m", 1.0),
}
SECTOR_HEIGHTS = tuple(f"sector_height_m_{k:02d}" for k in range(1, SECTORS + 1))
SECTOR_MASSES = tuple(f"sector_mass_kg_{k:02d}" for k in range(1, SECTORS + 1))
CHARGE_OBSERVABLES: Mapping[str, Quantity] = {
    **{name: _height() for name in SECTOR_HEIGHTS},
    **{name: Quantity("kg", 0.0, 1e6) for name in SECTOR_MASSES},
    "far_pile_height_m": _height(),
    "near_pile_height_m": _height(),
    "d50_far_m": _positive("m", 1.0),
    "d50_near_m": _positive("m", 1.0),
    "belt_depth_m": _positive("m", 5.0),
    "discharge_t25_s": _positive("s", 1e5),
    "discharge_t50_s": _positive("s", 1e5),
    "discharge_t100_s": _positive("s", 1e5),
}
# What a plan may say that it will read: an observable, or whole surfaces.
SURFACES = "profiles"
OBSERVABLES_OF: Mapping[str, Mapping[str, Quantity]] = {
    "pile": PILE_OBSERVABLES,
    "charge": CHARGE_OBSERVABLES,
}

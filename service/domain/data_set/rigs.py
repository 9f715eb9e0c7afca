"""The sizes of each material's rig, m, for which an empty cell stands.

They are demcore's (a test compares them): this format stands alone, so that who hides an effect can share it with
who looks for one.
"""

from __future__ import annotations

from collections.abc import Mapping


def _rig(base_diameter: float, cylinder_diameter: float, cylinder_height: float) -> Mapping[str, float]:
    return {
        "base_diameter_m": base_diameter,
        "cylinder_diameter_m": cylinder_diameter,
        "cylinder_height_m": cylinder_height,
    }


RIGS: Mapping[str, Mapping[str, float]] = {
    "coke": _rig(1.5, 1.2, 1.6),
    "sinter": _rig(1.5, 1.2, 1.5),
    "pellet": _rig(0.6, 0.35, 0.45),
    "sinter65_pellet35": _rig(1.5, 1.2, 1.5),
}

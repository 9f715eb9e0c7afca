"""Faults of what measures: they change readings, whatever made the heap. Lengths m, angles deg, masses kg.

sensor_offset     every height reads a more
sensor_tilt@K     the scanned plane is turned by a, up towards azimuth K: h + tan(a) r cos(theta - K)
weigh_gain        every mass, and what is derived from one, reads 1 + a times as much
sample_bias       every median size reads 1 + a times as large

The centre of a scanned heap moves with the plane: integral of h x over that of h; a plane of slope t on a round
base of radius R adds pi R^4 t / 4 to the first and nothing to the second.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from worker.diagnosis.simulator import FloatArray

OFFSET, TILT, GAIN, BIAS = "sensor_offset", "sensor_tilt", "weigh_gain", "sample_bias"
SENSOR_EFFECTS = (OFFSET, TILT, GAIN, BIAS)
_HEIGHTS = ("apex_height_m",)
_MASSES = ("mass_on_base_kg", "bulk_density_kg_m3")
_SIZES = ("d50_on_base_m",)


def is_sensor(key: str) -> bool:
    """Whether an effect's key names a fault of what measures."""
    return key.partition("@")[0] in SENSOR_EFFECTS


def misread(
    values: Mapping[str, float], effects: Mapping[str, float], base_radius: float, volume: float
) -> dict[str, float]:
    """What the faulty sensors tell of one pile; `volume` of the heap, m3."""
    read = dict(values)
    for names, factor in ((_MASSES, GAIN), (_SIZES, BIAS)):
        for name in names:
            read[name] *= 1.0 + effects.get(factor, 0.0)
    for name in _HEIGHTS:
        read[name] += effects.get(OFFSET, 0.0)
    along_x, along_y = _slopes(effects)
    moment = 0.25 * math.pi * base_radius**4 / volume if volume > 0.0 else math.nan
    if along_x or along_y:
        read["heap_offset_x_m"] += moment * along_x
        read["heap_offset_y_m"] += moment * along_y
    return read


def misread_surface(
    heights: FloatArray, theta_deg: FloatArray, r_m: FloatArray, effects: Mapping[str, float]
) -> FloatArray:
    """Heights (p,), m, as faulty sensors tell them."""
    along_x, along_y = _slopes(effects)
    theta = np.radians(theta_deg)
    plane = r_m * (along_x * np.cos(theta) + along_y * np.sin(theta))
    return np.asarray(heights + effects.get(OFFSET, 0.0) + plane)


def _slopes(effects: Mapping[str, float]) -> tuple[float, float]:
    x = y = 0.0
    for key, amplitude in effects.items():
        name, _, azimuth = key.partition("@")
        if name == TILT and amplitude:
            slope, angle = math.tan(math.radians(amplitude)), math.radians(float(azimuth or 0.0))
            x, y = x + slope * math.cos(angle), y + slope * math.sin(angle)
    return x, y

"""The analytic truth: another made-up world than the analyser's stand-in, from which measured data are drawn.

It shares geometry with the stand-in (a cone is a cone) and nothing else: hyperbolic and power laws where that has
exponentials, other constants, effects with laws of their own, scatter with heavy tails. It imports nothing of the
analyser. Lengths m, masses kg, times s.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.domain.data_set.columns import SECTOR_HEIGHTS, SECTOR_MASSES
from service.domain.data_set.records import Condition

Array = NDArray[np.float64]
Amplitudes = Mapping[str, float]

_G = 9.81


class Theta(NamedTuple):
    """Sliding friction, rolling resistance, wall friction, restitution of one material."""

    slide: float
    roll: float
    wall: float
    bounce: float


class Stuff(NamedTuple):
    """Median size, sd of ln d, particle density."""

    d50: float
    width: float
    rho: float


STUFF = {
    "coke": Stuff(0.050, 0.45, 847.0),
    "sinter": Stuff(0.028, 0.60, 3105.0),
    "pellet": Stuff(0.012, 0.20, 3480.0),
}
# By effect of the library: the largest amplitude that is drawn, and whether it may be negative.
EFFECTS: Mapping[str, tuple[float, bool]] = {
    "cohesion": (2.0, False),
    "shape_roll": (0.8, True),
    "size_friction": (0.5, True),
    "wide_psd": (0.8, False),
    "density": (0.3, True),
    "soft_stiffness": (3.0, False),
    "vel_restitution": (0.5, False),
    "lift_speed": (1.5, True),
    "base_rough": (0.4, True),
    "liner_wear": (0.4, True),
    "feed_offcentre": (0.3, False),
    "belt_speed": (0.3, True),
    "belt_track": (0.2, True),
    "deflector_shift": (0.2, True),
    "deflector_tilt": (20.0, True),
    "deflector_wear": (0.2, False),
    "air_drag": (5.0, False),
    "breakage": (0.4, False),
    "vibration": (1.5, False),
    "sensor_offset": (0.2, True),
    "sensor_tilt": (10.0, False),
    "weigh_gain": (0.2, True),
    "sample_bias": (0.5, True),
}


class Bed(NamedTuple):
    """What pile and charge share: effective grains, slope (tangent), packing."""

    d50: float
    width: float
    rho: float
    slide: float
    roll: float
    wall: float
    bounce: float
    wet: float
    fines: float
    slope: float
    packing: float

    @property
    def bulk(self) -> float:
        return self.rho * self.packing


def bed(c: Condition, theta: Theta, a: Amplitudes) -> Bed:
    """The grains of a condition with effects of amplitudes `a`."""
    stuff = STUFF[c.material]
    ln_d = math.log(stuff.d50 / 0.02)
    slide = theta.slide * math.exp(a.get("size_friction", 0.0) * ln_d)
    roll = theta.roll * (1.0 + math.sinh(a.get("shape_roll", 0.0) * ln_d))
    extra = a.get("base_rough", 0.0) if c.test == "pile" else a.get("liner_wear", 0.0)
    wall = max(theta.wall + extra, 0.02)
    fall = c.drop_height_m + (2.0 if c.test == "charge" else 0.0)
    slowed = 1.0 + a.get("vel_restitution", 0.0) * math.log1p(fall) * 1.2
    bounce = theta.bounce / (slowed if fall > 0.5 else 1.0)
    wet = a.get("cohesion", 0.0) * math.tanh(c.moisture_percent / 3.2)
    fines = a.get("breakage", 0.0) * fall / (fall + 0.9)
    shaken, spread = a.get("vibration", 0.0), a.get("wide_psd", 0.0)
    slope = 0.15 + 0.285 * math.tanh(slide / 0.40) + 0.50 * roll / (roll + 0.17) * math.tanh(slide / 0.42)
    slope *= (c.mass_kg / 100.0) ** -0.0205 / (1.0 + 0.55 * bounce * fall**1.1 / (fall**1.1 + 2.2))
    slope *= (1.0 + 0.13 * wet - 0.02 * wet**2) / (1.0 + 0.24 * shaken) * math.exp(-0.05 * spread)
    packing = 0.662 - 0.061 * slide / (slide + 0.36) - 0.029 * math.tanh(roll / 0.38)
    packing += (
        0.048 * math.tanh(stuff.width - 0.45)
        + 0.11 * math.tanh(spread)
        + 0.034 * shaken / (1.0 + 0.1 * shaken)
    )
    packing += -0.06 * wet / (1.0 + 0.1 * wet) - 0.045 * a.get("shape_roll", 0.0) * ln_d + 0.05 * fines
    return Bed(
        stuff.d50,
        stuff.width,
        stuff.rho * (1.0 + a.get("density", 0.0)),
        slide,
        roll,
        wall,
        bounce,
        wet,
        fines,
        slope,
        packing,
    )


def observe(c: Condition, theta: Theta, a: Amplitudes) -> dict[str, float]:
    """Noiseless observables of one condition."""
    return _pile(c, bed(c, theta, a), a) if c.test == "pile" else _charge(c, bed(c, theta, a), a)


def _pile(c: Condition, b: Bed, a: Amplitudes) -> dict[str, float]:
    radius = 0.5 * (c.base_diameter_m or 1.5)
    slope = b.slope * (0.945 + 0.085 * b.wall / (b.wall + 0.28))
    pulled = 0.0
    if c.removal == "lift":
        speed = c.lift_speed_m_s * math.exp(a.get("lift_speed", 0.0))
        pulled = 0.11 * speed / (speed + 0.1)
    slope *= 1.0 - pulled
    most = b.bulk * math.pi / 3.0 * radius**3 * slope * (0.86 + 0.36 * b.wall / (b.wall + 0.32))
    stays = most * (1.0 - math.exp(-((c.mass_kg / most) ** 3.8))) ** (1.0 / 3.8)
    sharp = 0.90 * (1.0 + 0.15 * math.tanh(b.wet)) / (1.0 + 0.06 * a.get("vibration", 0.0)) - 0.42 * pulled
    apex = (3.0 * stays / b.bulk * slope**2 / math.pi) ** (1.0 / 3.0) * sharp
    slow = (1.0 + 1.13 * b.slide**0.95) * math.exp(0.42 * b.roll) / (1.0 + 0.22 * b.wall)
    slow *= (1.0 + 0.3 * b.wet / (1.0 + 0.15 * b.wet)) * (1.0 - pulled) ** 1.2
    t90 = math.sqrt(2.0 * radius / _G) * slow * math.exp(-0.09 * a.get("vibration", 0.0))
    aside = 0.55 * a.get("feed_offcentre", 0.0)
    direction = math.radians(a.get("azimuth", 0.0))
    lean = math.sin(math.radians(a.get("sensor_tilt", 0.0))) * 0.42 * radius
    flat = math.exp(-10.0 * aside**2)
    gain = 1.0 + a.get("weigh_gain", 0.0)
    d50 = b.d50 * (1.0 + 0.05 * b.width) * math.exp(0.17 * a.get("wide_psd", 0.0)) / (1.0 + 1.3 * b.fines)
    return {
        "repose_angle_deg": math.degrees(math.atan(slope * flat)),
        "apex_height_m": apex * flat + a.get("sensor_offset", 0.0),
        "mass_on_base_kg": stays * gain,
        "discharge_t90_s": t90 * (1.0 + a.get("clock", 0.0)),
        "bulk_density_kg_m3": b.bulk * gain,
        "heap_offset_x_m": (aside + lean) * math.cos(direction),
        "heap_offset_y_m": (aside + lean) * math.sin(direction),
        "d50_on_base_m": d50 * (1.0 + a.get("sample_bias", 0.0)),
    }


def _charge(c: Condition, b: Bed, a: Amplitudes) -> dict[str, float]:
    speed = c.belt_speed_m_s * (1.0 + a.get("belt_speed", 0.0))
    depth = c.feed_rate_kg_s / (speed * b.bulk * 0.8) * (0.91 + 0.14 * b.slope)
    drag = 0.02 * (1.0 - math.exp(-0.8 * a.get("air_drag", 0.0))) * (0.02 / b.d50) ** 1.1
    worn = a.get("deflector_wear", 0.0)
    ridge = c.deflector_ridge_across_m + 0.18 + a.get("deflector_shift", 0.0) + 0.45 * math.tanh(1.2 * worn)
    throw = 0.36 * (speed - 1.79) + 0.6 * (depth - 0.05) - drag
    width = 0.155 + 1.4 * worn / (1.0 + worn) + 0.10 * b.bounce**1.1 + 0.05 * c.drop_height_m
    side = math.tanh(0.80 * (throw - ridge) / width)
    tilt = c.deflector_near_pitch_deg - c.deflector_far_pitch_deg + 2.0 * a.get("deflector_tilt", 0.0)
    skew = 0.23 * math.sin(math.radians(tilt))
    pitch = 0.5 * (c.deflector_near_pitch_deg + c.deflector_far_pitch_deg)
    apart = (
        0.31 + 0.0042 * (pitch - 45.0) + 0.26 * b.bounce / (0.9 + b.bounce / 3.0) - 0.9 * worn - 0.3 * drag
    )
    lean = 0.6 * math.sin(2.6 * a.get("belt_track", 0.0))
    firm = 1.0 + 0.022 * a.get("soft_stiffness", 0.0) * (c.mass_kg / 5000.0) ** 0.9
    mean = c.mass_kg / (b.bulk / firm * 8.0) + a.get("sensor_offset", 0.0)
    relief = 0.5 * b.slope
    m = [1.0, 0.55 * side + skew, lean, apart * (1.0 - 0.2 * side**2), -0.5 * lean * side]
    direction = math.radians(a.get("azimuth", 0.0))
    plane = math.sin(math.radians(a.get("sensor_tilt", 0.0))) * 1.15
    across, along = plane * math.cos(direction), plane * math.sin(direction)
    h = [
        mean,
        relief * (0.8 * m[1] + 0.5 * skew) + across,
        relief * 0.8 * m[2] + along,
        1.2 * relief * m[3],
        relief * m[4],
    ]
    angle = 2.0 * np.pi * np.arange(24) / 24.0
    waves = np.stack([np.ones(24), np.cos(angle), np.sin(angle), np.cos(2 * angle), np.sin(2 * angle)])
    gain = 1.0 + a.get("weigh_gain", 0.0)
    found = dict(zip(SECTOR_HEIGHTS, (np.array(h) @ waves).tolist(), strict=True))
    masses = c.mass_kg / 24.0 * gain * (np.array(m) @ waves)
    found |= dict(zip(SECTOR_MASSES, np.maximum(masses, 0.0).tolist(), strict=True))
    peak = relief * (1.0 + 0.33 * math.tanh(b.wet))
    sort = 0.12 * b.width + 0.13 * math.tanh(a.get("wide_psd", 0.0))
    sort += 0.035 * math.log1p(a.get("air_drag", 0.0)) * (0.02 / b.d50) ** 0.6
    d50 = (
        b.d50
        * (1.0 + a.get("sample_bias", 0.0))
        * math.exp(0.17 * a.get("wide_psd", 0.0))
        / (1.0 + 1.3 * b.fines)
    )
    return found | {
        "far_pile_height_m": mean + across + peak * (0.7 + m[1] + 0.6 * skew),
        "near_pile_height_m": mean - across + peak * (0.7 - m[1] + 0.6 * skew),
        "d50_far_m": d50 * math.exp(sort * (1.0 - 0.3 * side)),
        "d50_near_m": d50 * math.exp(-sort * (1.0 + 0.3 * side)) / (1.0 + 0.7 * b.fines),
        "belt_depth_m": depth * (1.0 + a.get("gauge", 0.0)),
        **_discharge(c, b, firm, a),
    }


def _discharge(c: Condition, b: Bed, firm: float, a: Amplitudes) -> dict[str, float]:
    rate = 0.58 * b.bulk * math.sqrt(_G) * (0.9 - 1.4 * b.d50) ** 2.5
    whole = c.mass_kg / rate * (1.0 + 0.49 * b.slide**0.97) * (1.0 + 0.22 * b.roll)
    whole *= (
        (1.0 + 0.23 * math.tanh(b.wet))
        * math.exp(-0.045 * a.get("vibration", 0.0))
        * (1.0 + a.get("clock", 0.0))
    )
    tail = 1.0 + 0.55 * b.wall / (b.wall + 0.26) + 0.28 * b.wet / (1.0 + 0.1 * b.wet) + 0.05 * (firm - 1.0)
    early = 1.0 + 0.11 * b.wall / (b.wall + 0.26) - 0.45 * (firm - 1.0)
    return {
        "discharge_t25_s": 0.20 * whole * early,
        "discharge_t50_s": 0.45 * whole * 0.5 * (early + tail),
        "discharge_t100_s": whole * tail,
    }


class Scatter(NamedTuple):
    """Run-to-run scatter of one observable: sd, of the logarithm or not."""

    sd: float
    is_relative: bool


SCATTER: Mapping[str, Scatter] = {
    "repose_angle_deg": Scatter(0.9, False),
    "apex_height_m": Scatter(0.027, True),
    "mass_on_base_kg": Scatter(0.015, True),
    "discharge_t90_s": Scatter(0.0375, True),
    "bulk_density_kg_m3": Scatter(0.015, True),
    "heap_offset_x_m": Scatter(0.0075, False),
    "heap_offset_y_m": Scatter(0.0075, False),
    "d50_on_base_m": Scatter(0.024, True),
    "far_pile_height_m": Scatter(0.018, False),
    "near_pile_height_m": Scatter(0.018, False),
    "d50_far_m": Scatter(0.03, True),
    "d50_near_m": Scatter(0.03, True),
    "belt_depth_m": Scatter(0.018, True),
    "discharge_t25_s": Scatter(0.027, True),
    "discharge_t50_s": Scatter(0.0225, True),
    "discharge_t100_s": Scatter(0.027, True),
    **dict.fromkeys(SECTOR_HEIGHTS, Scatter(0.03, False)),
    **dict.fromkeys(SECTOR_MASSES, Scatter(0.0525, True)),
}
# Correlations within a run, as shared factors: observables, the share of the variance that is common, sign.
SHARED = (
    (("repose_angle_deg", "apex_height_m"), 0.5),
    (("discharge_t25_s", "discharge_t50_s", "discharge_t100_s"), 0.35),
    (SECTOR_HEIGHTS, 0.10),
    (("far_pile_height_m", "near_pile_height_m"), 0.2),
)


def natural(values: Mapping[str, float]) -> dict[str, float]:
    """Logarithms where the scatter is relative, the values themselves elsewhere."""
    return {
        name: math.log(max(value, 1e-9)) if SCATTER[name].is_relative else value
        for name, value in values.items()
    }


def correlation(names: list[str]) -> Array:
    """Of one run's scatter over these observables."""
    R = np.eye(len(names))
    for group, share in SHARED:
        member = np.array([name in group for name in names])
        R += share * (np.outer(member, member) & ~np.eye(len(names), dtype=bool))
    return R

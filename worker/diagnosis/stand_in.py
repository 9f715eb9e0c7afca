"""An analytic stand-in for the DEM: closed forms of how a pile and a charge answer, made up for this purpose.

It is no physics to rely on. It has what a diagnosis must cope with: four calibration parameters a material,
responses that bend, effects that resemble each other, run-to-run scatter with correlations. The figures that the
bench prints hold for it, not for the DEM. Lengths m, masses kg, times s; arrays are over the n runs of a batch.
"""

from __future__ import annotations

import hashlib
import math
import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from service.domain.data_set.columns import SECTOR_HEIGHTS, SECTOR_MASSES, SECTORS
from service.domain.data_set.records import Condition
from service.domain.effects import Library, library
from worker.diagnosis.simulator import FloatArray, Outcomes, Parameter, Setting

_G = 9.81
_D_REF = 0.02
_HOPPER_AREA = 8.0


class Grains(NamedTuple):
    """Median size, spread of ln d, particle density."""

    d50: float
    spread: float
    density: float


MATERIALS = {
    "coke": Grains(0.050, 0.45, 847.0),
    "sinter": Grains(0.028, 0.60, 3105.0),
    "pellet": Grains(0.012, 0.20, 3480.0),
}
PARAMETERS = (
    Parameter("particle_particle_static_friction", 0.1, 0.9),
    Parameter("rolling_resistance", 0.05, 0.6),
    Parameter("particle_wall_static_friction", 0.1, 0.9),
    Parameter("particle_particle_restitution", 0.1, 0.6),
)


class StandIn:
    """The stand-in as a Simulator; `known` is the library whose scopes it honours."""

    version = "analytic-stand-in-1"
    parameters = PARAMETERS

    def __init__(self, known: Library | None = None) -> None:
        self._known = library() if known is None else known

    def cannot(self, condition: Condition) -> str | None:
        """A material without a table needs its sizes and density."""
        given = condition.psd is not None and condition.particle_density_kg_m3 is not None
        if condition.material in MATERIALS or given:
            return None
        known = ", ".join(MATERIALS)
        return f"{condition.material!r} is none of {known}, and its psd and particle density are not given"

    def run(self, condition: Condition, settings: Sequence[Setting]) -> Outcomes:
        """See Simulator. Raises ValueError for a condition that it cannot represent."""
        why = self.cannot(condition)
        if why is not None:
            raise ValueError(why)
        acting = {k for e in self._known.effects if e.acts_on(condition) for k in e.keys}
        heard = [
            s._replace(effects=tuple((k, a) for k, a in s.effects if k in acting and a)) for s in settings
        ]
        amplitudes: dict[str, FloatArray] = {}
        for i, setting in enumerate(heard):
            for key, amplitude in setting.effects:
                amplitudes.setdefault(key, np.zeros(len(heard)))[i] = amplitude
        bed = _Bed(condition, np.array([s.parameters for s in heard]), amplitudes)
        noise = _normals(condition, heard)
        values = _pile(bed, noise) if condition.test == "pile" else _charge(bed, noise)
        return Outcomes(values)


_NORMALS = 20 + 2 * SECTORS


def _normals(condition: Condition, settings: Sequence[Setting]) -> FloatArray:
    """Standard normals (n, 68) that depend on the condition and each run's setting alone (splitmix64)."""
    head = repr(condition.settings).encode()
    keys = np.array([_digest(head, s) for s in settings], dtype=np.uint64)
    with np.errstate(over="ignore"):
        z = keys[:, None] + np.uint64(0x9E3779B97F4A7C15) * np.arange(1, _NORMALS + 1, dtype=np.uint64)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    uniform = ((z ^ (z >> np.uint64(31))) >> np.uint64(11)).astype(np.float64) * 2.0**-53 + 2.0**-54
    return np.asarray(ndtri(uniform))


def _digest(head: bytes, setting: Setting) -> int:
    effects = "".join(f"{key}={amplitude!r};" for key, amplitude in sorted(setting.effects)).encode()
    body = struct.pack(f"{len(setting.parameters)}dq", *setting.parameters, setting.seed)
    return int.from_bytes(hashlib.blake2b(head + body + effects, digest_size=8).digest(), "little")


def _s(a: FloatArray) -> FloatArray:
    """Saturates from 0 to 1."""
    return np.asarray(1.0 - np.exp(-a))


class _Bed:
    """The grains of one condition under n settings: effective friction, slope and packing."""

    def __init__(
        self, condition: Condition, parameters: FloatArray, amplitudes: dict[str, FloatArray]
    ) -> None:
        self.condition = condition
        self._amplitudes = amplitudes
        self.n = len(parameters)
        self.d50, self.spread, density = _grains(condition)
        self.density = density * (1.0 + self.a("density"))
        mu, roll, wall, e = parameters.T
        ln_d = math.log(self.d50 / _D_REF)
        self.wall = np.maximum(wall + self.a("base_rough") + self.a("liner_wear"), 0.0)
        self.mu = mu * np.maximum(1.0 + self.a("size_friction") * ln_d, 0.05)
        self.roll = roll * np.maximum(1.0 + self.a("shape_roll") * ln_d, 0.05)
        self.shape = self.a("shape_roll") * ln_d
        fall = condition.drop_height_m + (2.0 if condition.test == "charge" else 0.0)
        self.fall = fall
        self.e = e * max(math.sqrt(2.0 * _G * fall), 1.0) ** -self.a("vel_restitution")
        self.bond = self.a("cohesion") * min(condition.moisture_percent / 4.0, 1.0)
        self.shaking = self.a("vibration")
        self.widening = self.a("wide_psd")
        self.fines = self.a("breakage") * (1.0 - math.exp(-fall / 1.5))
        self.slope = self._slope()
        self.packing = self._packing()

    def a(self, key: str) -> FloatArray:
        found = self._amplitudes.get(key)
        return np.zeros(self.n) if found is None else found

    @property
    def bulk_density(self) -> FloatArray:
        return np.asarray(self.density * self.packing)

    def _slope(self) -> FloatArray:
        """Tangent of the repose angle."""
        steep = 0.15 + 0.28 * _s(self.mu / 0.25) + 0.42 * _s(self.roll / 0.2) * _s(self.mu / 0.3)
        impact = 1.0 - 0.5 * self.e * self.fall / (self.fall + 2.0)
        mass = 1.0 - 0.02 * math.log(self.condition.mass_kg / 100.0)
        wet = 1.0 + 0.10 * self.bond
        shaken = 1.0 - 0.20 * self.shaking
        return np.asarray(steep * impact * mass * wet * shaken * (1.0 - 0.06 * self.widening))

    def _packing(self) -> FloatArray:
        loose = 0.66 - 0.05 * _s(self.mu / 0.4) - 0.03 * _s(self.roll / 0.3) + 0.05 * (self.spread - 0.45)
        changed = 0.10 * self.widening + 0.03 * self.shaking - 0.05 * self.bond - 0.05 * self.shape
        return np.asarray(loose + changed + 0.06 * self.fines)


def _grains(condition: Condition) -> Grains:
    """Of the condition's own sizes and density where given."""
    table = MATERIALS.get(condition.material, Grains(math.nan, math.nan, math.nan))
    d50, spread = table.d50, table.spread
    if condition.psd is not None:
        logs, shares = np.log([s for s, _ in condition.psd]), np.array([w for _, w in condition.psd])
        centre = float(shares @ logs)
        d50, spread = math.exp(centre), math.sqrt(float(shares @ (logs - centre) ** 2))
    density = condition.particle_density_kg_m3 or table.density
    return Grains(d50, spread, density)


def _pile(bed: _Bed, z: FloatArray) -> dict[str, FloatArray]:
    c = bed.condition
    radius = 0.5 * (c.base_diameter_m or 1.5)
    grip = 0.85 + 0.3 * _s(bed.wall / 0.35)
    slope = bed.slope * (0.94 + 0.08 * _s(bed.wall / 0.3))
    lifting = np.zeros(bed.n)
    if c.removal == "lift":
        lifting = 0.08 * np.log1p(c.lift_speed_m_s * np.exp(bed.a("lift_speed")) / 0.1)
    slope = slope * (1.0 - lifting)
    most = bed.bulk_density * math.pi / 3.0 * radius**3 * slope * grip
    stays = (c.mass_kg**-6.0 + most**-6.0) ** (-1.0 / 6.0)
    volume = stays / bed.bulk_density
    sharp = 0.90 + 0.12 * bed.bond - 0.05 * bed.shaking - 0.4 * lifting
    apex = np.cbrt(3.0 * volume * slope**2 / math.pi) * sharp
    slow = (1.0 + 1.1 * bed.mu + 0.7 * bed.roll - 0.3 * bed.wall) * (1.0 + 0.25 * bed.bond)
    t90 = math.sqrt(2.0 * radius / _G) * slow * (1.0 - 1.2 * lifting) * (1.0 - 0.1 * bed.shaking)
    tilt = [np.tan(np.radians(bed.a(f"sensor_tilt@{k}"))) * 0.45 * radius for k in (0, 90)]
    offset = [0.6 * bed.a(f"feed_offcentre@{k}") for k in (0, 90)]
    gain = 1.0 + bed.a("weigh_gain")
    d50 = bed.d50 * (1.0 + 0.05 * bed.spread + 0.2 * bed.widening) * (1.0 - 1.2 * bed.fines)
    lean = 1.0 - 12.0 * sum(o**2 for o in offset)
    return {
        "repose_angle_deg": np.degrees(np.arctan(slope * lean)) + 0.35 * z[:, 0] + 0.35 * z[:, 1],
        "apex_height_m": apex * lean * np.exp(0.010 * z[:, 0] + 0.010 * z[:, 2]) + bed.a("sensor_offset"),
        "mass_on_base_kg": stays * gain * np.exp(0.006 * z[:, 3]),
        "discharge_t90_s": t90 * np.exp(0.02 * z[:, 4]),
        "bulk_density_kg_m3": bed.bulk_density * gain * np.exp(0.007 * z[:, 5]),
        "heap_offset_x_m": offset[0] + tilt[0] + 0.005 * z[:, 6],
        "heap_offset_y_m": offset[1] + tilt[1] + 0.005 * z[:, 7],
        "d50_on_base_m": d50 * (1.0 + bed.a("sample_bias")) * np.exp(0.015 * z[:, 8]),
    }


class _Stream(NamedTuple):
    """How the deflector divides the stream: far share, lean, distance and skew of the heaps, belt depth."""

    far: FloatArray
    lean: FloatArray
    apart: FloatArray
    skew: FloatArray
    depth: FloatArray


def _stream(bed: _Bed) -> _Stream:
    c = bed.condition
    speed = c.belt_speed_m_s * (1.0 + bed.a("belt_speed"))
    depth = c.feed_rate_kg_s / (speed * bed.bulk_density * 0.8) * (0.9 + 0.15 * bed.slope)
    drag = bed.a("air_drag") * 0.015 * (_D_REF / bed.d50)
    throw = 0.36 * (speed - 1.79) + 0.6 * (depth - 0.05) - drag
    wear = bed.a("deflector_wear")
    ridge = c.deflector_ridge_across_m + 0.18 + bed.a("deflector_shift") + 0.5 * wear
    width = 0.16 + 1.2 * wear + 0.08 * bed.e + 0.05 * c.drop_height_m
    far = ndtr((throw - ridge) / width)
    pitch = c.deflector_near_pitch_deg - c.deflector_far_pitch_deg + 2.0 * bed.a("deflector_tilt")
    mean_pitch = 0.5 * (c.deflector_near_pitch_deg + c.deflector_far_pitch_deg)
    apart = 0.30 + 0.004 * (mean_pitch - 45.0) + 0.25 * bed.e - 1.0 * wear - 0.3 * drag
    return _Stream(far, 1.6 * bed.a("belt_track"), apart, 0.004 * pitch, depth)


def _charge(bed: _Bed, z: FloatArray) -> dict[str, FloatArray]:
    c = bed.condition
    stream = _stream(bed)
    skew = stream.skew
    side = 2.0 * stream.far - 1.0
    firm = 1.0 + 0.02 * bed.a("soft_stiffness") * c.mass_kg / 5000.0
    mean = c.mass_kg / (bed.bulk_density / firm * _HOPPER_AREA)
    m_c1, m_s1 = 0.55 * side + skew, stream.lean
    m_c2, m_s2 = stream.apart * (1.0 - 0.2 * side**2), -0.5 * stream.lean * side
    relief = bed.slope * 0.5
    plane = [np.tan(np.radians(bed.a(f"sensor_tilt@{k}"))) * 1.2 for k in (0, 90)]
    h_c1 = relief * (0.8 * m_c1 + 0.5 * skew) + plane[0]
    h_s1 = relief * 0.8 * m_s1 + plane[1]
    h_c2, h_s2 = relief * m_c2 * 1.2, relief * m_s2
    zero = bed.a("sensor_offset")
    angle = 2.0 * np.pi * np.arange(SECTORS) / SECTORS
    waves = np.stack([np.ones(SECTORS), np.cos(angle), np.sin(angle), np.cos(2 * angle), np.sin(2 * angle)])
    shift = z[:, :5] * np.array([0.006, 0.008, 0.008, 0.006, 0.006])
    heights = (np.column_stack([mean + zero, h_c1, h_s1, h_c2, h_s2]) + shift) @ waves
    heights = heights + 0.015 * z[:, 20 : 20 + SECTORS]
    wobble = z[:, 5:10] * np.array([0.004, 0.012, 0.012, 0.010, 0.010])
    shares = (np.column_stack([np.ones(bed.n), m_c1, m_s1, m_c2, m_s2]) + wobble) @ waves
    gain = 1.0 + bed.a("weigh_gain")
    masses = (c.mass_kg / SECTORS * gain)[:, None] * (shares + 0.03 * z[:, 20 + SECTORS :])
    values = dict(zip(SECTOR_HEIGHTS, heights.T, strict=True))
    values |= dict(zip(SECTOR_MASSES, np.maximum(masses, 0.0).T, strict=True))
    peak = relief * (1.0 + 0.3 * bed.bond)
    values["far_pile_height_m"] = mean + zero + plane[0] + peak * (0.7 + m_c1 + 0.6 * skew) + 0.012 * z[:, 10]
    values["near_pile_height_m"] = (
        mean + zero - plane[0] + peak * (0.7 - m_c1 + 0.6 * skew) + 0.012 * z[:, 11]
    )
    values["belt_depth_m"] = stream.depth * np.exp(0.012 * z[:, 12])
    return values | _sizes(bed, side, z) | _discharge(bed, firm, z)


def _sizes(bed: _Bed, side: FloatArray, z: FloatArray) -> dict[str, FloatArray]:
    sorting = 0.12 * (bed.spread + bed.widening) + 0.03 * bed.a("air_drag") * (_D_REF / bed.d50) ** 0.5
    bias = 1.0 + bed.a("sample_bias")
    d50 = bed.d50 * bias * (1.0 + 0.2 * bed.widening) * (1.0 - 1.2 * bed.fines)
    return {
        "d50_far_m": d50 * np.exp(sorting * (1.0 - 0.3 * side) + 0.02 * z[:, 13]),
        "d50_near_m": d50 * np.exp(-sorting * (1.0 + 0.3 * side) - 0.6 * bed.fines + 0.02 * z[:, 14]),
    }


def _discharge(bed: _Bed, firm: FloatArray, z: FloatArray) -> dict[str, FloatArray]:
    """Beverloo's law with slowing by friction; the wall holds back the last quarter."""
    opening = (0.9 - 1.4 * bed.d50) ** 2.5
    rate = 0.58 * bed.bulk_density * math.sqrt(_G) * opening
    slow = (1.0 + 0.5 * bed.mu + 0.25 * bed.roll) * (1.0 + 0.20 * bed.bond) * (1.0 - 0.05 * bed.shaking)
    whole = bed.condition.mass_kg / rate * slow
    tail = 1.0 + 0.5 * _s(bed.wall / 0.4) + 0.25 * bed.bond + 0.06 * (firm - 1.0)
    early = 1.0 + 0.10 * _s(bed.wall / 0.4) - 0.5 * (firm - 1.0)
    shared = 0.008 * z[:, 15]
    return {
        "discharge_t25_s": 0.20 * whole * early * np.exp(shared + 0.010 * z[:, 16]),
        "discharge_t50_s": 0.45 * whole * (0.5 * early + 0.5 * tail) * np.exp(shared + 0.008 * z[:, 17]),
        "discharge_t100_s": whole * tail * np.exp(shared + 0.012 * z[:, 18]),
    }

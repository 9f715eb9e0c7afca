"""What a pile test measured: angles, profile, masses, discharge, and every assumption that went in."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.case_run import CaseRun
from demcore.errors import NoResult
from demcore.experiments.pile_case import PileTest
from demcore.experiments.pile_run import PilePlan
from demcore.observables.repose_angle import (
    AngleReading,
    HeapProfile,
    heap_profile,
    literal_reading,
    scan_heights,
    surface_scan,
    top_height,
)
from demcore.output.spheres import write_spheres
from demcore.particles import VX, VZ, Floats, M, R, X, Z
from demcore.simulation import Simulation


class Observable(NamedTuple):
    """A measured number, its unit, what it is, and the standard error where one run tells it (None: only other
    seeds do)."""

    name: str
    value: float
    unit: str
    meaning: str
    standard_error: float | None


# What every pile yields, by name: its key in the summary, unit, meaning.
OBSERVABLES: Mapping[str, tuple[str, str, str]] = {
    "angle_deg": ("angle_deg", "deg", "repose angle of the scanned surface, mean over the sectors"),
    "literal_angle_deg": ("literal_angle_deg", "deg", "repose angle by the paper's literal reading"),
    "mass_on_base_kg": ("mass_on_base_kg", "kg", "mass that stays on the base"),
    "share_on_base": ("share_on_base", "1", "that mass over the mass filled"),
    "heap_height_m": ("apex_height_m", "m", "height of the heap's highest point over the base"),
    "heap_top_m": ("heap_top_m", "m", "mean height of the surface within .15 of the base's radius"),
    "discharge_t50_s": ("discharge_t50_s", "s", "time until half of what leaves the base has left"),
    "discharge_t90_s": ("discharge_t90_s", "s", "time until 90 % of what leaves the base has left"),
    "fill_height_m": ("fill_height_m", "m", "height of the settled column before the cylinder goes"),
    "heap_offset_x_m": ("heap_offset_x_m", "m", "centre of mass of what lies on the base, along x"),
    "heap_offset_y_m": ("heap_offset_y_m", "m", "centre of mass of what lies on the base, along y"),
    "d50_on_base_m": ("d50_on_base_m", "m", "median diameter by mass on the base, of the real grains"),
    "filled_bulk_density_kg_m3": ("filled_bulk_density_kg_m3", "kg/m3", "bulk density of that column"),
}


@dataclass(frozen=True)
class PileResult:
    """A pile at rest. Positions (N, 3) m with the base at z = 0, radii (N,) m, velocities (N, 3) m/s,
    material rows (N,); discharge: (K, 2) time since removal (s) and share of the mass still there."""

    test: PileTest
    scan: AngleReading
    literal: AngleReading
    literal_share_few: float
    profile: HeapProfile
    positions: Floats
    radii: Floats
    velocities: Floats
    material_rows: NDArray[np.int32]
    numbers: dict[str, float]
    wall_s: float

    @property
    def angle_deg(self) -> float:
        """The scanned repose angle, the one that is calibrated."""
        return self.scan.mean

    @property
    def angle_sd_deg(self) -> float:
        """Standard error over the sectors; the scatter between seeds is the noise that counts."""
        return self.scan.standard_error

    @property
    def literal_angle_deg(self) -> float:
        return self.literal.mean

    @property
    def r_m(self) -> Floats:
        return self.profile.radius

    @property
    def h_m(self) -> Floats:
        return self.profile.height

    @property
    def h_low_m(self) -> Floats:
        return self.profile.low

    @property
    def h_high_m(self) -> Floats:
        return self.profile.high

    def observables(self) -> tuple[Observable, ...]:
        """What a calibration may compare with the lab."""
        errors = {"angle_deg": self.angle_sd_deg, "literal_angle_deg": self.literal.standard_error}
        values = {"angle_deg": self.angle_deg, "literal_angle_deg": self.literal_angle_deg, **self.numbers}
        return tuple(
            Observable(name, float(values[key]), unit, meaning, errors.get(name))
            for name, (key, unit, meaning) in OBSERVABLES.items()
        )

    def summary(self) -> dict[str, Any]:
        """All numbers, JSON-able, with units in the names."""
        t = self.test
        return {
            "angle_deg": self.angle_deg,
            "angle_standard_error_deg": self.angle_sd_deg,
            "sector_angles_deg": [None if math.isnan(a) else float(a) for a in self.scan.sectors],
            "fit_intercept_m": self.scan.intercept,
            "literal_angle_deg": self.literal_angle_deg,
            "literal_standard_error_deg": self.literal.standard_error,
            "literal_share_of_bins_under_3": self.literal_share_few,
            **self.numbers,
            "observables": {o.name: o._asdict() for o in self.observables()},
            "wall_s": self.wall_s,
            "profile": {
                "r_m": self.r_m.tolist(),
                "h_m": self.h_m.tolist(),
                "h_low_m": self.h_low_m.tolist(),
                "h_high_m": self.h_high_m.tolist(),
            },
            "material": t.material.name,
            "scale": t.scale,
            "seed": t.seed,
            "fill_level": t.fill_level,
            "lift_speed_m_s": t.lift_speed,
            "contact_model": t.contact_model,
            "time_step_preset": t.time_step,
            "diameters_across_base_radius": t.diameters_across_base,
            "parameters": dataclasses.asdict(t.parameters),
            "rig": dataclasses.asdict(t.rig),
        }

    def write(self, path: Path) -> None:
        """The pile as VTKHDF, with the summary inside the file; same test, same bytes, so no clock's number."""
        summary = {name: value for name, value in self.summary().items() if name != "wall_s"}
        write_spheres(
            path,
            self.positions,
            self.radii,
            {"Velocity": self.velocities, "Material": self.material_rows},
            summary,
        )


def measure_pile(test: PileTest, run: CaseRun, plan: PilePlan) -> PileResult:
    """Read the pile of a finished run. Raises NoResult when the base holds nothing to measure."""
    s = run.simulation
    base = test.rig.base_radius
    state = s.particles.state
    on = (np.hypot(state[:, X], state[:, X + 1]) < base) & (state[:, Z] > 0.0)
    if not on.any():
        raise NoResult("nothing lies on the base: no pile to measure")
    state, rows = state[on], s.particles.material[on]
    position, radius = state[:, X : Z + 1].copy(), state[:, R].copy()
    field = scan_heights(position, radius, base)
    literal, few = literal_reading(position, base, test.rig.circular_sectors, test.rig.radial_sectors)
    numbers = {
        "mass_on_base_kg": float(state[:, M].sum()),
        "mass_filled_kg": run.filled_kg,
        "share_on_base": float(state[:, M].sum()) / run.filled_kg,
        "fill_height_m": plan.fill_height,
        "filled_bulk_density_kg_m3": _bulk_density(test, run.filled_kg, plan.fill_height),
        "heap_top_m": top_height(field, base),
        "apex_height_m": float(field.height.max()),
        "heap_offset_x_m": float(np.average(position[:, 0], weights=state[:, M])),
        "heap_offset_y_m": float(np.average(position[:, 1], weights=state[:, M])),
        "d50_on_base_m": _median_diameter(radius, state[:, M]) / test.scale,
        "discharge_t50_s": _discharge_time(s, plan.removed_at, 0.5),
        "discharge_t90_s": _discharge_time(s, plan.removed_at, 0.9),
        "particles_filled": run.filled,
        "particles_on_base": int(on.sum()),
        "simulated_s": s.time,
        "settled_at_s": plan.removed_at * s.dt,
        "time_step_s": s.dt,
        "steps": s.step,
        "neighbour_searches": s.searches,
        "particle_steps": s.particle_steps,
    }
    return PileResult(
        test,
        surface_scan(field, base),
        literal,
        few,
        heap_profile(field, base),
        position,
        radius,
        state[:, VX : VZ + 1].copy(),
        rows,
        numbers,
        run.wall_seconds,
    )


def _bulk_density(test: PileTest, mass: float, fill_height: float) -> float:
    """kg/m3 of the settled column; 0 for one without height."""
    volume = math.pi * test.rig.cylinder_radius**2 * fill_height
    return mass / volume if volume > 0.0 else 0.0


def _median_diameter(radius: Floats, mass: Floats) -> float:
    """m, below which half of the mass lies."""
    order = np.argsort(radius)
    return 2.0 * float(radius[order][np.searchsorted(np.cumsum(mass[order]), 0.5 * mass.sum())])


def _discharge_time(simulation: Simulation, removed_at: int, share: float) -> float:
    """Seconds after removal until `share` of all mass that left had left."""
    left = simulation.left.all()
    if len(left.mass) == 0:
        return 0.0
    mass = np.cumsum(left.mass)
    k = min(int(np.searchsorted(mass, share * mass[-1])), len(mass) - 1)
    return float((left.step[k] - removed_at) * simulation.dt)

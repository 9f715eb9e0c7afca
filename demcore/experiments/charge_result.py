"""What a charge left: the burden by sector, piles, depressions, sizes, and what was watched on the way."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from demcore.case_run import CaseRun
from demcore.errors import NoResult
from demcore.experiments.charge_case import ChargeTest
from demcore.experiments.charge_run import (
    BELT,
    FLIGHT,
    HOPPER,
    LOST,
    SECTION_LENGTH,
    Account,
    ChargePlan,
    bowl_of,
    places_of,
)
from demcore.observables.belt_flow import BeltSection, JetEnvelope
from demcore.observables.burden import (
    SECTORS,
    Depression,
    Harmonic,
    Pile,
    Sectors,
    Shadow,
    Surface,
    bell_layer,
    far_share,
    find_depressions,
    find_piles,
    harmonic,
    is_far,
    measure_sectors,
    scan_surface,
    sector_of,
    segregation,
    side_sizes,
    variation,
)
from demcore.observables.pile_slope import pile_slope
from demcore.observables.wear import WearMap
from demcore.particles import VX, VZ, Floats, M, R, X, Z
from demcore.plant.checks import level_of
from demcore.plant.parts import Plant

# A heap or a valley counts when the surface's mean by sector stands out by this share of the mean thickness.
LEAST_PROMINENCE = 0.05
# Of the arc behind the rod, degrees to either side.
BEHIND_ROD = 45.0
# The layer that leaves first when the bell opens, m from the seat's circle; at least two of the largest grains.
BELL_LAYER = 0.3


@dataclass(frozen=True)
class ChargeResult:
    """The end of a charge. Positions (N, 3) m, radii (N,) m, velocities (N, 3) m/s, masses (N,) kg, material rows
    and numbers (N,); places (N,) BELT, FLIGHT, HOPPER or LOST; what the plan watched. `wall_s` is the clock's."""

    test: ChargeTest
    positions: Floats
    radii: Floats
    velocities: Floats
    masses: Floats
    material_rows: NDArray[np.int32]
    particle_numbers: NDArray[np.int64]
    places: NDArray[np.int64]
    accounts: tuple[Account, ...]
    section: BeltSection
    jet: JetEnvelope
    aim: JetEnvelope
    wear: WearMap
    numbers: dict[str, float]
    wall_s: float

    @cached_property
    def in_hopper(self) -> NDArray[np.bool_]:
        """Which grains are the burden."""
        return np.asarray(self.places == HOPPER)

    @cached_property
    def surface(self) -> Surface:
        """Of the burden."""
        return scan_surface(
            self.positions[self.in_hopper], self.radii[self.in_hopper], bowl_of(self.test.plant)
        )

    @cached_property
    def sectors(self) -> Sectors:
        """The burden by circumferential sector."""
        inside = self.in_hopper
        return measure_sectors(
            self.positions[inside], self.radii[inside], self.masses[inside], self.surface, SECTORS
        )

    @property
    def least_prominence(self) -> float:
        """m, from which a heap or a valley counts."""
        return LEAST_PROMINENCE * float(self.surface.thickness.mean())

    @cached_property
    def piles(self) -> list[Pile]:
        """In order of azimuth."""
        inside = self.in_hopper
        return find_piles(
            self.positions[inside],
            self.radii[inside],
            self.masses[inside],
            self.surface,
            self.least_prominence,
            SECTORS,
        )

    @cached_property
    def depressions(self) -> list[Depression]:
        """With what keeps material from them."""
        return find_depressions(self.sectors.height, self.least_prominence, shadows(self.test.plant))

    def harmonics(self) -> dict[str, Harmonic]:
        """First and second of mass, height above the seat and size, by name."""
        s, seat = self.sectors, -self.test.plant.hopper.seat_depth
        values = {"mass": s.mass, "height": s.height - seat, "size": s.size}
        return {f"{name}_{k}": harmonic(v, k) for name, v in values.items() for k in (1, 2)}

    def summary(self) -> dict[str, Any]:
        """All numbers, JSON-able, with units in the names."""
        return {
            **self.numbers,
            **self._burden(),
            **self._belt(),
            **self._walls(),
            "account": {f: [getattr(a, f) for a in self.accounts] for f in Account._fields},
            "inputs": describe_charge(self.test),
            "wall_s": self.wall_s,
        }

    def _burden(self) -> dict[str, Any]:
        s, inside, plant = self.sectors, self.in_hopper, self.test.plant
        position, radius, mass = self.positions[inside], self.radii[inside], self.masses[inside]
        of = sector_of(position[:, 0], position[:, 1], SECTORS)
        index, chance = segregation(of, radius, mass, SECTORS)
        seat = (plant.hopper.seat_radius, -plant.hopper.seat_depth)
        layer = max(BELL_LAYER, 4.0 * float(radius.max()))
        layer_mass, layer_size = bell_layer(position, radius, mass, seat, layer, SECTORS)
        near_size, far_size = side_sizes(position, radius, mass, hatch_azimuth(plant))
        volume = float(s.volume.sum())
        return {
            "sectors": {name: getattr(s, name).tolist() for name in Sectors._fields},
            "variation_of_mass": variation(s.mass),
            "variation_of_height": variation(s.height - seat[1]),
            "variation_of_volume": variation(s.volume),
            "variation_of_size": variation(s.size),
            "harmonics": {name: h._asdict() for name, h in self.harmonics().items()},
            "piles": [
                p._asdict() | {"slope": pile_slope(self.surface, p.azimuth_deg, p.radius)._asdict()}
                for p in self.piles
            ],
            "depressions": [d._asdict() for d in self.depressions],
            "segregation_intensity": index,
            "segregation_of_a_random_mix": chance,
            "far_share_of_mass": far_share(position, mass, hatch_azimuth(plant)),
            "near_side_size_m": near_size,
            "far_side_size_m": far_size,
            "volume_m3": volume,
            "bulk_density_kg_m3": float(mass.sum()) / volume,
            "level_if_even_m": level_of(plant, volume),
            "mean_diameter_m": float((mass * 2.0 * radius).sum() / mass.sum()),
            "bell_layer": {"within_m": layer, "mass_kg": layer_mass.tolist(), "size_m": layer_size.tolist()},
        }

    def _belt(self) -> dict[str, Any]:
        heights, shares, sizes = self.section.size_by_height()
        far, near_size, far_size = self.aim.split(0, self.test.plant.deflector.ridge_across)
        ridge, beyond = self.aim.beyond(0)
        return {
            "belt": {
                "rate_kg_s": carried_rate(self.accounts, self.numbers["steady_from_s"], self.test),
                "set_rate_kg_s": self.test.charge.rate,
                "kg_per_m": self.section.mass_per_metre(SECTION_LENGTH),
                "stratification": self.section.stratification(),
                "layer_height_m": heights.tolist(),
                "layer_share": shares.tolist(),
                "layer_size_m": sizes.tolist(),
            },
            "jet": {
                "level_m": self.jet.levels.tolist(),
                "x_5_50_95_m": self.jet.quantiles().tolist(),
                "at_ridge_x_5_50_95_m": self.aim.quantiles()[0].tolist(),
                "far_of_ridge": far,
                "ridge_at_m": ridge.tolist(),
                "far_of_that_ridge": beyond.tolist(),
                "size_near_of_ridge_m": near_size,
                "size_far_of_ridge_m": far_size,
            },
        }

    def _walls(self) -> dict[str, Any]:
        walls = self.test.case.walls
        table = self.wear.by_wall(len(walls))
        return {
            "walls": {
                wall.name: {"energy_J": energy, "strikes": strikes, "load_N": load}
                for wall, (energy, strikes, load) in zip(walls, table.tolist(), strict=True)
            }
        }

    def findings(self) -> dict[str, Any]:
        """The paper's four findings (section 3.2) as numbers: piles near and far, their heights above the seat,
        mean sizes and slopes, and the causes of the depressions. Near and far are by the upright plane through
        axis and hatch."""
        meridian, seat = hatch_azimuth(self.test.plant), -self.test.plant.hopper.seat_depth
        sides: dict[str, list[Pile]] = {"near": [], "far": []}
        for pile in self.piles:
            angle = math.radians(pile.azimuth_deg)
            place = np.array([[math.cos(angle), math.sin(angle), 0.0]])
            sides["far" if is_far(place, meridian)[0] else "near"].append(pile)
        highest = {side: max(piles, key=lambda p: p.height, default=None) for side, piles in sides.items()}
        found: dict[str, Any] = {"piles": len(self.piles)}
        for side, chosen in highest.items():
            found[f"{side}_height_m"] = None if chosen is None else chosen.height - seat
            found[f"{side}_size_m"] = None if chosen is None else chosen.size
            found[f"{side}_mass_kg"] = None if chosen is None else chosen.mass
            slope = None if chosen is None else pile_slope(self.surface, chosen.azimuth_deg, chosen.radius)
            found[f"{side}_slope_deg"] = slope.angle_deg if slope and slope.directions else None
        return found | {"depressions": sorted({d.cause for d in self.depressions})}


def hatch_azimuth(plant: Plant) -> float:
    """Of the hatch's middle, degrees."""
    return math.degrees(math.atan2(plant.hatch.centre_along, plant.hatch.centre_across))


def shadows(plant: Plant) -> tuple[Shadow, Shadow]:
    """Where material hardly comes: under the deflector, and behind the rod as the deflector sees it."""
    d = plant.deflector
    azimuth = math.degrees(math.atan2(d.ridge_along, d.ridge_across))
    distance = max(math.hypot(d.ridge_across, d.ridge_along), 1e-9)
    near, far = (math.radians(p) for p in (d.near_pitch_deg, d.far_pitch_deg))
    reach = d.face_length * max(math.cos(near), math.cos(far))
    half = math.degrees(math.atan2(reach, distance))
    return Shadow("under the deflector", azimuth, half), Shadow("behind the rod", azimuth + 180.0, BEHIND_ROD)


def carried_rate(accounts: tuple[Account, ...], steady_from: float, test: ChargeTest) -> float:
    """kg/s that left the belt while its bed was steady: by least squares over the account, from one ride after it
    became steady until the feed ended; nan when that is less than a ride."""
    ride = test.plant.belt.ride_seconds
    rows = [
        (a.time, a.fed - a.on_belt) for a in accounts if steady_from + ride <= a.time <= test.charge.duration
    ]
    if len(rows) < 3 or rows[-1][0] - rows[0][0] < ride:
        return math.nan
    time, left = np.array(rows).T
    return float(np.polyfit(time - time.mean(), left, 1)[0])


def measure_charge(test: ChargeTest, run: CaseRun, plan: ChargePlan) -> ChargeResult:
    """Read a charge that has ended. Raises NoResult when nothing lies in the hopper."""
    s = run.simulation
    numbers, state, rows = run.by_number()
    places = places_of(state[:, X : Z + 1], state[:, R], test.plant)
    if not (places == HOPPER).any():
        raise NoResult("nothing lies in the hopper: no burden to measure")
    gone, end = s.left.all(), plan.accounts[-1]
    read = {
        "fed_kg": end.fed,
        "asked_kg": run.accounts[0].asked_kg,
        "on_belt_kg": float(state[places == BELT, M].sum()),
        "in_flight_kg": float(state[places == FLIGHT, M].sum()),
        "in_hopper_kg": float(state[places == HOPPER, M].sum()),
        "lost_kg": float(state[places == LOST, M].sum() + gone.mass.sum()),
        "missing_kg": end.missing,
        "squeezed_through_walls": s.squeezed,
        "particles": run.accounts[0].born,
        "particles_in_hopper": int((places == HOPPER).sum()),
        "steady_from_s": plan.steady_from,
        "fed_at_s": plan.fed_at,
        "simulated_s": s.time,
        "time_step_s": s.dt,
        "steps": s.step,
        "neighbour_searches": s.searches,
        "particle_steps": s.particle_steps,
        "merged_share_of_mass": test.merged_share,
        "largest_diameter_m": test.largest_diameter,
    }
    return ChargeResult(
        test,
        state[:, X : Z + 1].copy(),
        state[:, R].copy(),
        state[:, VX : VZ + 1].copy(),
        state[:, M].copy(),
        rows,
        numbers,
        places,
        tuple(plan.accounts),
        plan.section,
        plan.jet,
        plan.aim,
        plan.wear,
        read,
        run.wall_seconds,
    )


def describe_charge(test: ChargeTest) -> dict[str, Any]:
    """Every input of a charge, JSON-able; of meshes in the place of parts their files and fingerprints."""
    plant = test.plant
    parts = {
        f.name: dataclasses.asdict(getattr(plant, f.name))
        for f in dataclasses.fields(plant)
        if dataclasses.is_dataclass(getattr(plant, f.name))
    }
    return {
        "charge": dataclasses.asdict(test.charge),
        "plant": parts | {"head_room": plant.head_room, "sources": dict(plant.sources)},
        "replaced": {r.part: {"file": r.file, "sha256": r.mesh.fingerprint()} for r in plant.replacements},
        "scale": test.scale,
        "seed": test.seed,
        "rest_seconds": test.rest_seconds,
        "largest_share": test.largest_share,
        "time_step": test.time_step,
        "time_step_factor": test.time_step_factor,
        "dormancy": None if test.dormancy is None else dataclasses.asdict(test.dormancy),
        "numerics": dataclasses.asdict(test.numerics),
    }

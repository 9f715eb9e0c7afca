"""What came out of a case, with every assumption that went in."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from demcore.case import Case
from demcore.case_run import CHECK_INTERVAL, CaseRun, Reading
from demcore.departures import Departures
from demcore.feeding import FeedAccount
from demcore.insertion import LOOSE_FRACTION
from demcore.particles import VX, VZ, WX, WZ, Floats, M, R, X, Z
from demcore.rest import RestWatch


@dataclass(frozen=True)
class Result:
    """The bed at the end of a run, particles in the order of their numbers.

    numbers (N,), positions (N, 3) m, velocities (N, 3) m/s, spins (N, 3) rad/s, radii (N,) m, masses (N,) kg,
    material_rows (N,); departures: who left the domain; history: the bed at every check; accounts: each feed's
    mass and particles. `ended` is `rest`, `duration` or `empty`. wall_s and particle_steps_per_s are the clock's
    and no part of the outcome.
    """

    case: Case
    identity: str
    ended: str
    time: float
    steps: int
    searches: int
    particle_steps: int
    numbers: NDArray[np.int64]
    positions: Floats
    velocities: Floats
    spins: Floats
    radii: Floats
    masses: Floats
    material_rows: NDArray[np.int32]
    departures: Departures
    history: tuple[Reading, ...]
    accounts: tuple[FeedAccount, ...]
    filled_kg: float
    assumptions: dict[str, Any]
    wall_s: float

    @property
    def particle_steps_per_s(self) -> float:
        """The run's rate."""
        return self.particle_steps / max(self.wall_s, 1e-9)

    @property
    def inserted_kg(self) -> float:
        """Mass of all particles that ever were."""
        return self.filled_kg + sum(a.born_kg for a in self.accounts)


def finished(run: CaseRun) -> Result:
    """The result of a run that has ended."""
    s = run.simulation
    numbers, state, rows = run.by_number()
    return Result(
        case=run.case,
        identity=run.identity,
        ended=run.ended,
        time=s.time,
        steps=s.step,
        searches=s.searches,
        particle_steps=s.particle_steps,
        numbers=numbers,
        positions=state[:, X : Z + 1].copy(),
        velocities=state[:, VX : VZ + 1].copy(),
        spins=state[:, WX : WZ + 1].copy(),
        radii=state[:, R].copy(),
        masses=state[:, M].copy(),
        material_rows=rows,
        departures=s.left.all(),
        history=tuple(run.history),
        accounts=run.accounts,
        filled_kg=run.filled_kg,
        assumptions=assumptions(run),
        wall_s=run.wall_seconds,
    )


def assumptions(run: CaseRun) -> dict[str, Any]:
    """Every choice behind a run that a reader of its numbers may want to question; JSON-able."""
    case = run.case
    watch = None if case.rest is None else RestWatch(case.rest, case.strength_of_gravity)
    return {
        "contact_model": case.contact_model,
        "numerics": dataclasses.asdict(case.numerics),
        "laws": {law: dict(numbers._asdict()) for law, numbers in run.simulation.model._asdict().items()},
        "long_term_damping": case.long_term_damping if case.contact_model == "paper" else None,
        "unlike_materials": case.interactions.unlike,
        "pairs_by_that_rule": case.interactions.assumed_pairs(case.grains),
        "particle_density_kg_m3": {g.name: g.particle_density for g in case.grains},
        "density_from": {
            g.name: "bulk density / packing fraction" if g.grain_density is None else "given"
            for g in case.grains
        },
        "sizes_inside_a_class": "uniform by mass",
        "fill": f"random sequential addition, loose ({LOOSE_FRACTION:g} solid), from the bottom upwards",
        "time_step_s": case.dt,
        "time_step_limit_s": case.largest_time_step,
        "time_step_given": case.time_step is not None,
        "gravity_m_s2": list(case.gravity),
        "rest": "never ends early" if watch is None else watch.sentence(),
        "dormancy": "everything is computed" if case.dormancy is None else case.dormancy.sentence(),
        "check_interval_s": CHECK_INTERVAL,
        "skin_in_smallest_radii": case.numerics.skin_share,
        "seed": case.seed,
    }

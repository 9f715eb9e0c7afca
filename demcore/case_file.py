"""The result file of a case: what was asked and assumed, what came out, every particle, and who left.

Named *.vtkhdf it opens in ParaView too, which shows the particles. Read it back by output.result_file.read_result.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from demcore.departures import SIDES
from demcore.identity import plain
from demcore.output.result_file import Column, write_result
from demcore.result import Result

KIND = "case"
SHOWN = {
    "Points": "particles/position",
    "Radius": "particles/radius",
    "Velocity": "particles/velocity",
    "AngularVelocity": "particles/spin",
    "Material": "particles/material",
    "Number": "particles/number",
}


def write_case(result: Result, path: Path) -> None:
    """Write the result of `demcore.run.simulate`; the same case gives the same bytes, so no clock's number."""
    columns = particle_columns(result) | departure_columns(result) | history_columns(result)
    columns |= mesh_columns(result)
    write_result(path, KIND, result.case.seed, plain(result.case), summary(result), columns, SHOWN)


def summary(result: Result) -> dict[str, Any]:
    """All single numbers, JSON-able, with units in the names, and every assumption."""
    return {
        "ended": result.ended,
        "identity": result.identity,
        "simulated_s": result.time,
        "time_step_s": result.case.dt,
        "steps": result.steps,
        "neighbour_searches": result.searches,
        "particle_steps": result.particle_steps,
        "particles": len(result.numbers),
        "mass_kg": float(result.masses.sum()),
        "filled_kg": result.filled_kg,
        "inserted_kg": result.inserted_kg,
        "departed": len(result.departures.number),
        "departed_kg": float(result.departures.mass.sum()),
        "feeds": [account._asdict() for account in result.accounts],
        "assumptions": result.assumptions,
    }


def particle_columns(result: Result) -> dict[str, Column]:
    """One row a particle, in the order of their numbers."""
    return {
        "particles/number": Column(result.numbers, "1", "number since the start of the run"),
        "particles/position": Column(result.positions, "m", "centres at the end"),
        "particles/velocity": Column(result.velocities, "m/s", "velocities at the end"),
        "particles/spin": Column(result.spins, "rad/s", "angular velocities at the end"),
        "particles/radius": Column(result.radii, "m", "radii"),
        "particles/mass": Column(result.masses, "kg", "masses"),
        "particles/material": Column(result.material_rows, "1", "row of the material table"),
    }


def departure_columns(result: Result) -> dict[str, Column]:
    """One row a particle that left the domain, in order of time."""
    left = result.departures
    return {
        "departures/number": Column(left.number, "1", "number since the start of the run"),
        "departures/step": Column(left.step, "1", "step at which it was seen outside"),
        "departures/time": Column(left.step * result.case.dt, "s", "time of that step"),
        "departures/position": Column(left.position, "m", "centre at that time"),
        "departures/velocity": Column(left.velocity, "m/s", "velocity at that time"),
        "departures/mass": Column(left.mass, "kg", "mass"),
        "departures/material": Column(left.material, "1", "row of the material table"),
        "departures/side": Column(left.side, "1", "side of the domain: " + ", ".join(SIDES) + " from 0"),
    }


def history_columns(result: Result) -> dict[str, Column]:
    """The bed at every check."""
    rows = np.array(result.history, np.float64)
    return {
        "history/time": Column(rows[:, 0], "s", "time of the check"),
        "history/particles": Column(rows[:, 1].astype(np.int64), "1", "particles in the domain"),
        "history/kinetic_energy": Column(rows[:, 2], "J", "of all motion and rotation"),
        "history/mass": Column(rows[:, 3], "kg", "mass in the domain"),
    }


def mesh_columns(result: Result) -> dict[str, Column]:
    """The triangles of walls that are meshes, of which the case's text has the checksum only."""
    columns = {}
    for k, wall in enumerate(result.case.walls):
        if wall.mesh is not None:
            name = f"walls/{k}"
            columns[f"{name}/vertices"] = Column(
                wall.mesh.vertices, "m", f"corners of wall {k} as it was made"
            )
            columns[f"{name}/faces"] = Column(wall.mesh.faces, "1", "three rows of vertices a triangle")
    return columns

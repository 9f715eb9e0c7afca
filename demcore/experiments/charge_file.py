"""The result file of a charge: what was asked and assumed, what came out, every grain, and what was watched."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from demcore.experiments.charge_result import ChargeResult, describe_charge
from demcore.experiments.charge_run import Account
from demcore.output.result_file import Column, write_result

KIND = "charge"
# The clock's, and so no part of an outcome; the inputs stand beside.
NOT_OUTCOME = ("wall_s", "inputs", "account")
SHOWN = {
    "Points": "particles/position",
    "Radius": "particles/radius",
    "Velocity": "particles/velocity",
    "Material": "particles/material",
    "Number": "particles/number",
    "Place": "particles/place",
}


def write_charge(result: ChargeResult, path: Path) -> None:
    """Write the result file; the same charge gives the same bytes. Named *.vtkhdf it opens in ParaView too."""
    summary = {name: value for name, value in result.summary().items() if name not in NOT_OUTCOME}
    columns = particle_columns(result) | watch_columns(result)
    write_result(path, KIND, result.test.seed, describe_charge(result.test), summary, columns, SHOWN)


def particle_columns(result: ChargeResult) -> dict[str, Column]:
    """One row a grain, in the order of their numbers."""
    return {
        "particles/number": Column(result.particle_numbers, "1", "number since the start of the run"),
        "particles/position": Column(result.positions, "m", "centres at the end"),
        "particles/velocity": Column(result.velocities, "m/s", "velocities at the end"),
        "particles/radius": Column(result.radii, "m", "radii"),
        "particles/mass": Column(result.masses, "kg", "masses"),
        "particles/material": Column(result.material_rows, "1", "row of the material table"),
        "particles/place": Column(result.places, "1", "0 belt, 1 in flight, 2 hopper, 3 lost"),
    }


def watch_columns(result: ChargeResult) -> dict[str, Column]:
    """The account over time, the belt's section, the jet, and the walls' wear."""
    rows = np.array(result.accounts, np.float64).reshape(-1, len(Account._fields))
    units = {"time": "s", "level": "m"}
    columns = {
        f"account/{name}": Column(
            rows[:, k], units.get(name, "kg"), f"{name.replace('_', ' ')} at every report"
        )
        for k, name in enumerate(Account._fields)
    }
    wall, place, values = result.wear.rows()
    return columns | {
        "belt/mass": Column(
            result.section.mass, "kg", "over the section, across by above, 20 mm cells, all samples"
        ),
        "belt/moment": Column(result.section.moment, "kg m", "mass times diameter, likewise"),
        "jet/level": Column(result.jet.levels, "m", "heights at which the jet was watched"),
        "jet/mass": Column(
            result.jet.mass, "kg", "that fell through each level, by 10 mm of x from the drum on"
        ),
        "wear/wall": Column(wall, "1", "wall of the case, in the order of the summary's walls"),
        "wear/place": Column(place, "m", "middles of the touched cells, 100 mm wide"),
        "wear/energy": Column(values[:, 0], "J", "brought across the wall by grains that struck it"),
        "wear/strikes": Column(values[:, 1], "1", "how many struck"),
        "wear/load": Column(values[:, 2], "N", "mean force across the wall at the end"),
    }

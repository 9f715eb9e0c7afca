"""Spheres as VTKHDF: a single pile in double precision, and the arrays of a time series."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from demcore.output.hdf_file import written
from demcore.output.vtkhdf import Field, PolyData, PolyDataSeries, replace_file

# Of a time series: single precision is what ParaView draws with.
SPHERE_FIELDS = (
    Field("Radius", "f4", 1, "m"),
    Field("Velocity", "f4", 3, "m/s"),
    Field("AngularVelocity", "f4", 3, "rad/s"),
    Field("Material", "i4"),
    Field("Number", "i8"),
)
UNITS = {"Radius": "m", "Diameter": "m", "Velocity": "m/s", "AngularVelocity": "rad/s"}


def vertices(count: int) -> NDArray[np.int64]:
    """A cell for every point."""
    return np.arange(count, dtype=np.int64)[:, None]


def write_spheres(
    path: Path,
    positions: NDArray[np.float64],
    radii: NDArray[np.float64],
    point_data: Mapping[str, ArrayLike],
    summary: Mapping[str, Any],
) -> None:
    """One pile: positions (N, 3) m, radii (N,) m, further arrays per sphere, and a summary as JSON.

    Positions and radii are kept in double precision, so that what was measured can be measured again. The file
    appears whole or not at all.
    """
    arrays = {"Radius": radii, "Diameter": 2.0 * radii}
    arrays |= {name: np.asarray(values) for name, values in point_data.items()}
    aside = path.with_name(path.name + ".part")
    start_file(aside, positions, arrays, UNITS)
    with written(aside, new=False) as file:
        # Readers of VTKHDF ignore groups that they do not know.
        file.create_group("Talus").attrs["summary"] = json.dumps(dict(summary))
    replace_file(aside, path)


def start_file(
    path: Path,
    positions: NDArray[np.float64],
    arrays: Mapping[str, NDArray[Any]],
    units: Mapping[str, str],
) -> None:
    """A new file with the VTKHDF group of one set of spheres: positions (N, 3) m in double precision, and arrays
    of N rows with their units ("1" where none is given)."""
    fields = [
        Field(name, a.dtype.str, 1 if a.ndim == 1 else a.shape[1], units.get(name, "1"))
        for name, a in arrays.items()
    ]
    with PolyDataSeries(path, "Vertices", fields, point_type="f8") as series:
        series.append(0.0, PolyData(positions, vertices(len(positions)), arrays, {}))

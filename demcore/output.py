"""VTKHDF files for ParaView and pyvista: spheres as PolyData vertices, format version 2.0, written with h5py.

Source: the VTKHDF file format specification; read back by VTK in a test of issue 3's tier.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

CELL_KINDS = ("Vertices", "Lines", "Polygons", "Strips")


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
    aside = path.with_name(path.name + ".part")
    count = len(radii)
    with h5py.File(aside, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 0], "i8")
        root.attrs.create("Type", b"PolyData", dtype=h5py.string_dtype("ascii", 8))
        root.create_dataset("NumberOfPoints", data=np.array([count], "i8"))
        root.create_dataset("Points", data=positions, compression="gzip", shuffle=True)
        for kind in CELL_KINDS:
            cells = count if kind == "Vertices" else 0
            group = root.create_group(kind)
            group.create_dataset("Connectivity", data=np.arange(cells, dtype="i8"))
            group.create_dataset("Offsets", data=np.arange(cells + 1, dtype="i8"))
            group.create_dataset("NumberOfCells", data=np.array([cells], "i8"))
            group.create_dataset("NumberOfConnectivityIds", data=np.array([cells], "i8"))
        data = root.create_group("PointData")
        data.create_dataset("Radius", data=radii, compression="gzip", shuffle=True)
        data.create_dataset("Diameter", data=2.0 * radii, compression="gzip", shuffle=True)
        for name, values in point_data.items():
            data.create_dataset(name, data=values, compression="gzip", shuffle=True)
        # Readers of VTKHDF ignore groups that they do not know.
        file.create_group("Talus").attrs["summary"] = json.dumps(dict(summary))
        file.flush()
    with open(aside, "rb") as written:
        os.fsync(written.fileno())
    os.replace(aside, path)

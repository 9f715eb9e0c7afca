"""VTKHDF files that ParaView and pyvista open: poly data, one part a time step, format version 2.0, by h5py.

Source: the VTKHDF file format specification (VTK documentation), "PolyData" and "Temporal data"; read back by
VTK's own reader in the tests. Every array is a dataset that grows; the group Steps says where a time step begins:

    Values (S,) time, s;  PartOffsets, NumberOfParts, PointOffsets (S,);  PointDataOffsets/NAME,
    CellDataOffsets/NAME (S,);  CellOffsets, ConnectivityIdOffsets (S, 4), one column per kind of cell
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from demcore.output.hdf_file import HdfWriter

CELL_KINDS = ("Vertices", "Lines", "Polygons", "Strips")
# Rows of a chunk: of arrays as long as the points, and of those with one row a time step.
LONG_CHUNK, SHORT_CHUNK = 16384, 256


class Field(NamedTuple):
    """An array per point or cell: its name, NumPy type, components and unit."""

    name: str
    dtype: str
    width: int = 1
    unit: str = "1"


class PolyData(NamedTuple):
    """One time step: points (N, 3) m; cells (C, K), rows of points (1: vertices, 3: triangles); arrays by name."""

    points: NDArray[Any]
    cells: NDArray[np.int64]
    point_data: Mapping[str, ArrayLike]
    cell_data: Mapping[str, ArrayLike]


class PolyDataSeries:
    """A file that grows by a time step at a time and is whole after each of them.

    ParaView may read it while it grows. Same steps, same bytes. Raises OSError, with the disk's
    errno, when the disk has no room; the file is lost then.
    """

    def __init__(
        self,
        path: Path,
        kind: str,
        point_fields: Sequence[Field],
        cell_fields: Sequence[Field] = (),
        point_type: str = "f4",
    ) -> None:
        self.kind = kind
        self._file = HdfWriter(path)
        root = self._root = self._file.root.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 0], "i8")
        root.attrs.create("Type", b"PolyData", dtype=h5py.string_dtype("ascii", 8))
        _long(root, Field("Points", point_type, 3, "m"))
        _short(root, "NumberOfPoints")
        for name in CELL_KINDS:
            group = root.create_group(name)
            _long(group, Field("Connectivity", "i8"))
            _long(group, Field("Offsets", "i8"))
            _short(group, "NumberOfCells")
            _short(group, "NumberOfConnectivityIds")
        self.fields = {"PointData": tuple(point_fields), "CellData": tuple(cell_fields)}
        steps = root.create_group("Steps")
        steps.attrs["NSteps"] = 0
        _short(steps, "Values", dtype="f8").attrs["units"] = "s"
        for name in ("PartOffsets", "NumberOfParts", "PointOffsets"):
            _short(steps, name)
        for name in ("CellOffsets", "ConnectivityIdOffsets"):
            _short(steps, name, (len(CELL_KINDS),))
        for place, fields in self.fields.items():
            group, offsets = root.create_group(place), steps.create_group(f"{place}Offsets")
            for field in fields:
                _long(group, field)
                _short(offsets, field.name)
        self._file.flush()

    def append(self, time: float, data: PolyData) -> None:
        """Add a time step with a geometry of its own."""
        steps = self._root["Steps"]
        self._mark(time, self._ends())
        count = len(data.points)
        _grow(self._root["Points"], data.points)
        _grow(self._root["NumberOfPoints"], [count])
        for name in CELL_KINDS:
            group = self._root[name]
            cells = data.cells if name == self.kind else np.empty((0, 1), np.int64)
            _grow(group["Connectivity"], cells.reshape(-1))
            _grow(group["Offsets"], np.arange(len(cells) + 1) * cells.shape[1])
            _grow(group["NumberOfCells"], [len(cells)])
            _grow(group["NumberOfConnectivityIds"], [cells.size])
        for place, values in (("PointData", data.point_data), ("CellData", data.cell_data)):
            for field in self.fields[place]:
                _grow(self._root[place][field.name], values[field.name])
        # Last of all: a reader counts the steps by it.
        steps.attrs["NSteps"] = len(steps["Values"])
        self._file.flush()

    def repeat(self, time: float) -> None:
        """Add a time step that shows what the one before it shows; it takes no room."""
        steps = self._root["Steps"]
        before = {name: steps[name][-1] for name in steps if isinstance(steps[name], h5py.Dataset)}
        for place, fields in self.fields.items():
            for field in fields:
                name = f"{place}Offsets/{field.name}"
                before[name] = steps[name][-1]
        self._mark(time, before)
        steps.attrs["NSteps"] = len(steps["Values"])
        self._file.flush()

    def _ends(self) -> dict[str, Any]:
        """Where a new part begins in every array."""
        root = self._root
        ends: dict[str, Any] = {
            "PartOffsets": len(root["NumberOfPoints"]),
            "NumberOfParts": 1,
            "PointOffsets": len(root["Points"]),
            # Offsets hold one more number a part than there are cells; readers add the parts themselves.
            "CellOffsets": [len(root[k]["Offsets"]) - len(root[k]["NumberOfCells"]) for k in CELL_KINDS],
            "ConnectivityIdOffsets": [len(root[k]["Connectivity"]) for k in CELL_KINDS],
        }
        for place, fields in self.fields.items():
            for field in fields:
                ends[f"{place}Offsets/{field.name}"] = len(root[place][field.name])
        return ends

    def _mark(self, time: float, offsets: Mapping[str, Any]) -> None:
        steps = self._root["Steps"]
        for name, value in offsets.items():
            if name != "Values":
                _grow(steps[name], [value])
        _grow(steps["Values"], [time])

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> PolyDataSeries:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _long(group: Any, field: Field) -> None:
    tail = () if field.width == 1 else (field.width,)
    dataset = group.create_dataset(
        field.name,
        shape=(0, *tail),
        maxshape=(None, *tail),
        dtype=field.dtype,
        chunks=(LONG_CHUNK, *tail),
        compression="gzip",
        compression_opts=4,
        shuffle=True,
    )
    dataset.attrs["units"] = field.unit


def _short(group: Any, name: str, tail: tuple[int, ...] = (), dtype: str = "i8") -> Any:
    return group.create_dataset(
        name, shape=(0, *tail), maxshape=(None, *tail), dtype=dtype, chunks=(SHORT_CHUNK, *tail)
    )


def _grow(dataset: Any, values: ArrayLike) -> None:
    rows = np.asarray(values)
    before = len(dataset)
    dataset.resize(before + len(rows), 0)
    if len(rows):
        dataset[before:] = rows


def replace_file(aside: Path, path: Path) -> None:
    """Give a finished file its name, on the disk before the name changes: it appears whole or not at all."""
    with open(aside, "rb") as written:
        os.fsync(written.fileno())
    os.replace(aside, path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)

"""A result and its case in one self-describing HDF5 file; the same run gives the same bytes.

Layout: the root's attributes say what the file is (`format`, `kind`), which code wrote it (`version`,
`source_sha256`) and from which `seed`; `case` and `summary` are JSON texts, whose numbers are in SI or carry
their units in their names, and null where they are not finite; every dataset has the attributes `units` and
`meaning`. No clock's number is in it. With particles to show, the file is a VTKHDF file as well: its arrays are
the columns themselves, by hard links, and the rest is ignored by ParaView.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from demcore.errors import InputError
from demcore.output.hdf_file import written
from demcore.output.spheres import start_file
from demcore.output.vtkhdf import replace_file
from demcore.source_hash import hash_sources

FORMAT = "talus-result-1"
PACKAGE = Path(__file__).parent.parent
# The group that VTK reads, and its name for the positions.
VTK_GROUP, POINTS = "VTKHDF", "Points"


class Column(NamedTuple):
    """An array with its unit ("1": a pure number) and what it means, in a few words."""

    values: NDArray[Any]
    units: str
    meaning: str


@dataclass(frozen=True)
class ResultFile:
    """What a file holds. `source_sha256` tells whether today's code would compute the same."""

    kind: str
    seed: int
    version: str
    source_sha256: str
    case: dict[str, Any]
    summary: dict[str, Any]
    columns: dict[str, Column]


def write_result(
    path: Path,
    kind: str,
    seed: int,
    case: Mapping[str, Any],
    summary: Mapping[str, Any],
    columns: Mapping[str, Column],
    shown: Mapping[str, str] | None = None,
) -> None:
    """Write `case` and `summary` (JSON-able) and the columns, by names like `profile/height`; all or nothing.

    `shown` has the columns of one row a particle that VTK shall show, by VTK's names; `Points` are the positions.
    """
    aside = path.with_name(path.name + ".part")
    links = {} if shown is None else _start_with_spheres(aside, columns, shown)
    with written(aside, new=not links) as file:
        file.attrs["format"] = FORMAT
        file.attrs["kind"] = kind
        file.attrs["seed"] = seed
        file.attrs["version"] = program_version()
        file.attrs["source_sha256"] = hash_sources(PACKAGE)
        for name, value in (("case", case), ("summary", summary)):
            text = json.dumps(without_nan(value), sort_keys=True, allow_nan=False)
            file.create_dataset(name, data=text, dtype=h5py.string_dtype("utf-8"))
            file[name].attrs["media_type"] = "application/json"
        for name, column in columns.items():
            if name in links:
                file[name] = file[links[name]]
            else:
                # HDF5 compresses in chunks, and nothing has none.
                packing = {"compression": "gzip", "shuffle": True} if np.size(column.values) else {}
                file.create_dataset(name, data=column.values, **packing)
            file[name].attrs["units"] = column.units
            file[name].attrs["meaning"] = column.meaning
    replace_file(aside, path)


def _start_with_spheres(
    path: Path, columns: Mapping[str, Column], shown: Mapping[str, str]
) -> dict[str, str]:
    """A new file with what VTK reads; where the values of each shown column stand in it."""
    arrays = {vtk: columns[name].values for vtk, name in shown.items() if vtk != POINTS}
    units = {vtk: columns[name].units for vtk, name in shown.items()}
    start_file(path, columns[shown[POINTS]].values, arrays, units)
    places = {vtk: f"{VTK_GROUP}/{POINTS if vtk == POINTS else 'PointData/' + vtk}" for vtk in shown}
    return {name: places[vtk] for vtk, name in shown.items()}


def read_result(path: Path) -> ResultFile:
    """Read a file of `write_result`. Raises InputError when it is none, or is not whole."""
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != FORMAT:
                raise InputError("result", path.name, f"a file of format {FORMAT}")
            return ResultFile(
                str(file.attrs["kind"]),
                int(file.attrs["seed"]),
                str(file.attrs["version"]),
                str(file.attrs["source_sha256"]),
                json.loads(file["case"].asstr()[()]),
                json.loads(file["summary"].asstr()[()]),
                _columns(file, ""),
            )
    except (OSError, KeyError) as error:
        raise InputError("result", path.name, f"a whole result file ({error})") from None


def _columns(group: Any, prefix: str) -> dict[str, Column]:
    """The columns below a group. HDF5's own walk would name a linked one by the first of its two places."""
    found: dict[str, Column] = {}
    for name, item in group.items():
        if isinstance(item, h5py.Dataset) and "units" in item.attrs:
            found[prefix + name] = Column(item[()], str(item.attrs["units"]), str(item.attrs["meaning"]))
        elif isinstance(item, h5py.Group) and name != VTK_GROUP:
            found |= _columns(item, f"{prefix}{name}/")
    return found


def program_version() -> str:
    """The installed version of Talus; `unknown` in a source tree that is not installed."""
    try:
        return metadata.version("talus")
    except metadata.PackageNotFoundError:
        return "unknown"


def without_nan(value: Any) -> Any:
    """`value` as JSON can hold it: numpy's numbers become Python's, what is not finite None."""
    if isinstance(value, Mapping):
        return {str(key): without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return without_nan(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value

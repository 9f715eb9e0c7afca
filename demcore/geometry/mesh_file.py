"""Triangle meshes from STL, OBJ and PLY files, read by trimesh; every check is ours.

trimesh drops or repairs what it does not like, and stops reading numbers at the first that is none. So it reads
without processing, its counts are compared with what the file announces, and the mesh is checked whole.
"""

from __future__ import annotations

import io
import os
import re
import struct
import warnings
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from demcore.errors import InputError
from demcore.geometry.mesh import MOST_TRIANGLES, TriangleMesh

UNITS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "inch": 0.0254}
# Which column of the file becomes x, y and z, and its sign: turned, never mirrored.
UP_AXES = {
    "x": ((1, 1.0), (2, 1.0), (0, 1.0)),
    "y": ((0, 1.0), (2, -1.0), (1, 1.0)),
    "z": ((0, 1.0), (1, 1.0), (2, 1.0)),
}
FORMATS = (".stl", ".obj", ".ply")
# The reader needs some ten times this memory; 5 million triangles in binary STL are 250 MB.
MOST_BYTES = 512 * 2**20
STL_HEADER, STL_TRIANGLE = 84, 50

# What trimesh and numpy raise on broken input; it documents no classes of its own.
UNREADABLE = (
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    NameError,  # trimesh's reader of PLY asks for a variable that a damaged header never set
    ArithmeticError,
    AssertionError,
    EOFError,
    RuntimeError,
    MemoryError,
    struct.error,
    DeprecationWarning,
)

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class MeshReport:
    """What was read: to be shown to the user and stored with the case. Lengths in m, area in m2, volume in m3,
    which is None unless the surface is closed and its triangles wind one way round."""

    file: str
    units: str
    up_axis: str
    triangles: int
    vertices: int
    merged_vertices: int
    watertight: bool
    open_edges: int
    crowded_edges: int
    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    area: float
    volume: float | None

    def record(self) -> dict[str, Any]:
        """As JSON-able numbers and texts."""
        return asdict(self)

    def line(self) -> str:
        """One line for a person."""
        size = " x ".join(f"{b - a:.4g}" for a, b in zip(self.lower, self.upper, strict=True))
        closed = "watertight" if self.watertight else f"not watertight ({self.open_edges} open edges)"
        volume = "" if self.volume is None else f", volume {self.volume:.4g} m3"
        return (
            f"{self.file}: {self.triangles} triangles, {size} m, read in {self.units} with {self.up_axis} up, "
            f"{closed}, area {self.area:.4g} m2{volume}"
        )


def load_mesh(path: Path, units: str | None = None, up_axis: str = "z") -> tuple[TriangleMesh, MeshReport]:
    """The mesh of a file in metres with z up, and a report. A file does not say its `units`, so they must be
    given: m, mm, cm or inch.

    Raises InputError: unknown units or axis, no such file, another format, a truncated or damaged file, a
    triangle without area (with its index), a number that is not finite.
    """
    if units not in UNITS:
        raise InputError("units", units, "one of " + ", ".join(UNITS) + " (a mesh file does not say its own)")
    if up_axis not in UP_AXES:
        raise InputError("up_axis", up_axis, "x, y or z")
    vertices, faces = _read(Path(path))
    columns = [sign * UNITS[units] * vertices[:, c] for c, sign in UP_AXES[up_axis]]
    # Adding zero turns -0 into 0, so that both are one vertex.
    merged, row = np.unique(np.column_stack(columns) + 0.0, axis=0, return_inverse=True)
    try:
        mesh = TriangleMesh(merged, _rows_of(row.ravel(), faces))
    except InputError as error:
        raise InputError(f"{Path(path).name}: {error.field}", error.value, error.allowed) from None
    return mesh, _report(mesh, Path(path).name, units, up_axis, len(vertices) - len(merged))


def save_mesh(mesh: TriangleMesh, path: Path, units: str = "mm") -> None:
    """Write a mesh as STL, OBJ or PLY in these units, whole or not at all; other programs expect millimetres.

    Raises InputError for unknown units or another format.
    """
    if units not in UNITS:
        raise InputError("units", units, "one of " + ", ".join(UNITS))
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"mesh file {path.name}", path.suffix or "no suffix", "one of " + ", ".join(FORMATS))
    import trimesh

    made = trimesh.Trimesh(mesh.vertices / UNITS[units], mesh.faces, process=False)
    aside = path.with_name(path.name + ".part")
    made.export(aside, file_type=path.suffix.lower()[1:])
    os.replace(aside, path)


def _rows_of(row: Integers, faces: Integers) -> Integers:
    """Faces over merged vertices; a corner that does not exist stays one that does not."""
    known = (faces >= 0) & (faces < len(row))
    return np.where(known, row[np.where(known, faces, 0)] if len(row) else -1, -1)


def _read(path: Path) -> tuple[Floats, Integers]:
    """Vertices and faces as the file has them."""
    field = f"mesh file {path.name}"
    kind = path.suffix.lower()
    if kind not in FORMATS:
        raise InputError(field, kind or "no suffix", "one of " + ", ".join(FORMATS))
    try:
        size = path.stat().st_size
        if not path.is_file() or not 0 < size <= MOST_BYTES:
            raise InputError(field, f"{size} bytes", f"a file of 1 to {MOST_BYTES} bytes")
        content = path.read_bytes()
    except OSError as error:
        raise InputError(field, error.strerror or "unreadable", "a file that can be read") from None
    announced = {".stl": _count_stl, ".obj": _count_obj, ".ply": _count_ply}[kind](content, field)
    if announced > MOST_TRIANGLES:
        raise InputError(field, f"{announced} triangles", f"at most {MOST_TRIANGLES}")
    broken = InputError(field, "no readable mesh", f"a whole {kind[1:].upper()} file with triangles")
    try:
        with warnings.catch_warnings():
            # numpy reports a text that stops being numbers by a warning only.
            warnings.filterwarnings("error", message=".*could not be read to its end.*")
            vertices, faces = _parse(content, kind[1:])
    except UNREADABLE:
        raise broken from None
    if len(faces) == 0:
        raise broken
    if len(faces) < announced:
        raise InputError(field, f"{len(faces)} of {announced} faces", "a whole file; this one is damaged")
    return vertices, faces


def _parse(content: bytes, kind: str) -> tuple[Floats, Integers]:
    """All geometries of a file as one soup."""
    # Here, because it brings scipy along and takes a second, which a process that reads no mesh need not wait.
    import trimesh

    scene = trimesh.load_scene(
        io.BytesIO(content),
        file_type=kind,
        process=False,
        maintain_order=True,
        skip_materials=True,
    )
    vertices, faces = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)]
    total = 0
    for geometry in scene.geometry.values():
        points = np.asarray(geometry.vertices, np.float64).reshape(-1, 3)
        corners = np.asarray(getattr(geometry, "faces", np.zeros((0, 3))), np.int64).reshape(-1, 3)
        if corners.size and not 0 <= corners.min() <= corners.max() < len(points):
            raise ValueError("a face has a corner that does not exist")
        vertices.append(points)
        faces.append(corners + total)
        total += len(points)
    return np.concatenate(vertices), np.concatenate(faces)


def _count_stl(content: bytes, field: str) -> int:
    """Triangles that an STL announces; refuses one that is neither whole binary nor whole text."""
    if len(content) >= STL_HEADER:
        count = int.from_bytes(content[80:84], "little")
        if len(content) == STL_HEADER + count * STL_TRIANGLE:
            return count
    text = content.lstrip()[:5].lower() == b"solid"
    if not text or b"\0" in content[:1000]:
        raise InputError(field, f"{len(content)} bytes", "a whole STL file; this one is truncated or no STL")
    facets = len(re.findall(rb"\bfacet\s+normal\b", content, re.IGNORECASE))
    ends = len(re.findall(rb"\bendfacet\b", content, re.IGNORECASE))
    corners = len(re.findall(rb"\bvertex\s", content, re.IGNORECASE))
    whole = re.search(rb"\bendsolid\b", content, re.IGNORECASE) is not None
    if not whole or facets != ends or corners != 3 * facets:
        raise InputError(field, f"{facets} facets, {ends} ends", "a whole STL file; this one is damaged")
    return facets


def _count_obj(content: bytes, field: str) -> int:
    """Faces of an OBJ; relative corners are refused, which the reader takes for others."""
    faces = re.findall(rb"^[ \t]*f[ \t]+(.*)$", content, re.MULTILINE)
    for line in faces:
        if b"-" in line or re.search(rb"(?:^|\s)0+(?:/|\s|$)", line):
            raise InputError(
                field, line.decode("ascii", "replace")[:60], "faces with absolute corners, counted from 1"
            )
    return len(faces)


def _count_ply(content: bytes, field: str) -> int:
    """Faces that a PLY announces; a count beyond what the file can hold is refused before anything is made."""
    end = content.find(b"end_header")
    if not content.startswith(b"ply") or end < 0:
        raise InputError(field, "no PLY header", "a whole PLY file")
    counts = {
        name.decode("ascii", "replace"): int(number)
        for name, number in re.findall(rb"^element\s+(\S+)\s+(\d{1,18})\s*$", content[:end], re.MULTILINE)
    }
    for name, count in counts.items():
        if count > len(content) - end:
            raise InputError(field, f"{count} of element {name}", "a whole PLY file; this one is truncated")
    return counts.get("face", 0)


def _report(mesh: TriangleMesh, name: str, units: str, up_axis: str, merged: int) -> MeshReport:
    directed = np.concatenate([mesh.faces[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    edges, uses = np.unique(np.sort(directed, axis=1), axis=0, return_counts=True)
    del edges
    watertight = bool((uses == 2).all())
    one_way = len(np.unique(directed, axis=0)) == len(directed)
    corners = mesh.corners()
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    used = mesh.vertices[np.unique(mesh.faces)]
    lower, upper = used.min(axis=0), used.max(axis=0)
    # From a point of the mesh, so that a far origin costs no digits.
    arms = corners[:, 0] - 0.5 * (lower + upper)
    volume = abs(float((arms * cross).sum())) / 6.0 if watertight and one_way else None
    return MeshReport(
        file=name,
        units=units,
        up_axis=up_axis,
        triangles=len(mesh.faces),
        vertices=len(mesh.vertices),
        merged_vertices=merged,
        watertight=watertight,
        open_edges=int((uses == 1).sum()),
        crowded_edges=int((uses > 2).sum()),
        lower=(float(lower[0]), float(lower[1]), float(lower[2])),
        upper=(float(upper[0]), float(upper[1]), float(upper[2])),
        area=0.5 * float(np.sqrt((cross**2).sum(axis=1)).sum()),
        volume=volume,
    )

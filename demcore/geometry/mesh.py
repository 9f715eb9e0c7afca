"""A surface of triangles, checked whole: finite, no triangle without an area, every corner known."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from demcore.errors import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MOST_TRIANGLES = 5_000_000
# A triangle whose height is below this share of its longest edge has no area that double precision can see.
THINNEST = 1e-12
# Vertices beyond this are a wrong unit or a broken file, and their squares would lose all digits.
FARTHEST = 1e9


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """`vertices` (V, 3), m; `faces` (T, 3), rows of vertices. The arrays are copied and read-only.

    Raises InputError for an empty mesh, a number that is not finite, a corner that does not exist, and a
    triangle without area, with its index.
    """

    vertices: Floats
    faces: Integers

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", _rows("mesh.vertices", self.vertices, np.float64))
        object.__setattr__(self, "faces", _rows("mesh.faces", self.faces, np.int64))
        if not 1 <= len(self.faces) <= MOST_TRIANGLES:
            raise InputError("mesh.faces", f"{len(self.faces)} triangles", f"1 to {MOST_TRIANGLES}")
        # The comparison is false for a NaN, so it is caught here too.
        bad = ~(np.abs(self.vertices) <= FARTHEST).all(axis=1)
        if bad.any():
            k = int(np.argmax(bad))
            raise InputError(
                f"mesh.vertices[{k}]", self.vertices[k].tolist(), f"finite coordinates within {FARTHEST:g} m"
            )
        bad = ((self.faces < 0) | (self.faces >= len(self.vertices))).any(axis=1)
        if bad.any():
            k = int(np.argmax(bad))
            raise InputError(
                f"mesh.faces[{k}]", self.faces[k].tolist(), f"rows of the {len(self.vertices)} vertices"
            )
        self._refuse_degenerate()

    def _refuse_degenerate(self) -> None:
        corners = self.corners()
        edges = np.roll(corners, -1, axis=1) - corners
        longest = np.sqrt((edges**2).sum(axis=2).max(axis=1))
        # Scaled first, so that a mesh in nanometres does not underflow.
        with np.errstate(invalid="ignore", divide="ignore"):
            unit = edges / longest[:, None, None]
            doubled = np.sqrt((np.cross(unit[:, 0], unit[:, 1]) ** 2).sum(axis=1))
        bad = ~(doubled > THINNEST)
        if bad.any():
            k = int(np.argmax(bad))
            more = f", as has {int(bad.sum()) - 1} more" if bad.sum() > 1 else ""
            raise InputError(
                f"mesh.faces[{k}]",
                np.round(corners[k], 9).tolist(),
                f"a triangle with an area; this one is degenerate{more}",
            )

    def corners(self) -> Floats:
        """(T, 3, 3) positions of the three corners of each triangle, m."""
        return self.vertices[self.faces]

    def normals(self) -> Floats:
        """(T, 3) unit normals, counter-clockwise corners seen from the tip."""
        c = self.corners()
        a, b = c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]
        a /= np.sqrt((a**2).sum(axis=1))[:, None]
        b /= np.sqrt((b**2).sum(axis=1))[:, None]
        n = np.cross(a, b)
        return np.asarray(n / np.sqrt((n**2).sum(axis=1))[:, None])

    def fingerprint(self) -> str:
        """sha256 of the arrays: what a case stores to know this mesh again."""
        return hashlib.sha256(self.vertices.tobytes() + self.faces.tobytes()).hexdigest()

    def __len__(self) -> int:
        return len(self.faces)


def _rows(field: str, value: object, kind: type) -> NDArray[np.generic]:
    """A read-only copy with three columns."""
    try:
        rows = np.array(value)
        kinds, wanted = ("iu", "integers") if kind is np.int64 else ("iuf", "numbers")
        if rows.dtype.kind not in kinds and rows.size:
            raise InputError(field, str(rows.dtype), f"an array of {wanted}")
        rows = np.ascontiguousarray(rows, kind)
    except (TypeError, ValueError, OverflowError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(field, type(value).__name__, "an array of three columns") from error
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise InputError(field, f"shape {rows.shape}", "an array of three columns")
    rows.flags.writeable = False
    return rows

"""Store an uploaded mesh that may stand for a part of the plant; the same bytes are one geometry."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import select
from sqlalchemy.orm import Session

from demcore.errors import InputError
from demcore.geometry.mesh_file import FORMATS, load_mesh
from service.db.models import GeometryRow
from service.domain.errors import InvalidValue
from service.file_store import FileStore

LONGEST_NAME = 100


def store_geometry(session: Session, store: FileStore, file_name: str, content: bytes) -> GeometryRow:
    """The row; `extent` is the size of the mesh in the file's own unit, which the file does not say.

    Raises InvalidValue for another format, a file that cannot be read whole, and a mesh that demcore refuses.
    """
    name = Path(file_name).name
    suffix = Path(name).suffix.lower()
    if suffix not in FORMATS or len(name) > LONGEST_NAME or not name.isprintable():
        raise InvalidValue(
            "file_name", file_name, "a short printable name that ends in " + ", ".join(FORMATS)
        )
    sha256 = hashlib.sha256(content).hexdigest()
    found = session.scalars(select(GeometryRow).where(GeometryRow.sha256 == sha256)).one_or_none()
    if found is not None:
        return found
    path = f"{sha256}{suffix}"
    with store.incoming() as folder:
        aside = folder / path
        aside.write_bytes(content)
        try:
            mesh, report = load_mesh(aside, "m")
            extent = _extent(mesh.vertices)
        except InputError as error:
            raise InvalidValue("geometry", name, error.allowed) from error
        store.put(aside, path)
    row = GeometryRow(
        file_name=name,
        sha256=sha256,
        size_bytes=len(content),
        triangles=report.triangles,
        extent={"x": extent[0], "y": extent[1], "z": extent[2], "watertight": report.watertight},
        path=path,
    )
    session.add(row)
    session.flush()
    return row


def _extent(vertices: NDArray[np.float64]) -> list[float]:
    """Size along x, y and z. Raises InputError where a difference of two finite corners is not finite."""
    with np.errstate(over="ignore"):
        found = [float(v) for v in np.ptp(vertices, axis=0)]
    if not np.isfinite(found).all():
        raise InputError("geometry", found, "corners whose distances are finite")
    return found

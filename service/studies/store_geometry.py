"""Store an uploaded mesh that may stand for a part of the plant; the same bytes are one geometry."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from demcore.errors import InputError
from demcore.geometry.mesh_file import FORMATS, load_mesh
from service.db.models import GeometryRow
from service.domain.errors import InvalidValue
from service.file_store import FileStore

LONGEST_NAME = 100


@dataclass(frozen=True)
class KeptMesh:
    """A mesh that was read and lies in the store, and what its row will say of it."""

    file_name: str
    sha256: str
    size_bytes: int
    triangles: int
    extent: dict[str, float | bool]
    path: str


def keep_mesh(store: FileStore, file_name: str, content: bytes) -> KeptMesh:
    """Read an upload and put it into the store; `extent` is in the file's own unit, which the file does not say.

    Without a transaction: every other writer would wait for a large mesh, or for a store that does not answer.
    Raises InvalidValue for another format, a file that cannot be read whole, and a mesh that demcore refuses;
    StoreAway.
    """
    name = Path(file_name).name
    suffix = Path(name).suffix.lower()
    if suffix not in FORMATS or len(name) > LONGEST_NAME or not name.isprintable():
        raise InvalidValue(
            "file_name", file_name, "a short printable name that ends in " + ", ".join(FORMATS)
        )
    sha256 = hashlib.sha256(content).hexdigest()
    path = f"{sha256}{suffix}"
    with store.incoming() as folder:
        aside = folder / path
        aside.write_bytes(content)
        try:
            mesh, report = load_mesh(aside, "m")
            x, y, z = _extent(mesh.vertices)
        except InputError as error:
            raise InvalidValue("geometry", name, error.allowed) from error
        store.put(aside, path)
    extent = {"x": x, "y": y, "z": z, "watertight": report.watertight}
    return KeptMesh(name, sha256, len(content), report.triangles, extent, path)


def store_geometry(session: Session, mesh: KeptMesh) -> GeometryRow:
    """The row; the same bytes give the one that is there."""
    wanted = select(GeometryRow).where(GeometryRow.sha256 == mesh.sha256)
    found = session.scalars(wanted).one_or_none()
    if found is not None:
        return found
    row = GeometryRow(**asdict(mesh))
    try:
        with session.begin_nested():
            session.add(row)
            session.flush()
    except IntegrityError:  # the same upload came at the same time
        return session.scalars(wanted).one()
    return row


def _extent(vertices: NDArray[np.float64]) -> list[float]:
    """Size along x, y and z. Raises InputError where a difference of two finite corners is not finite."""
    with np.errstate(over="ignore"):
        found = [float(v) for v in np.ptp(vertices, axis=0)]
    if not np.isfinite(found).all():
        raise InputError("geometry", found, "corners whose distances are finite")
    return found

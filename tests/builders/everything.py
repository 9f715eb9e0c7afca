"""One row of everything that a route's address can name, and all routes there are."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from hashlib import sha256

from fastapi import FastAPI
from sqlalchemy import select
from starlette.routing import BaseRoute, Route

from service.db.models import ArtifactRow, DesignRow, DiagnosisRow, GeometryRow, JobRow, ModelVersionRow
from service.db.session import Database
from service.domain.effects import library
from service.domain.outcome import StoredArtifact
from service.settings import Settings
from service.studies.keep_files import keep_files
from tests.builders.charges import charges
from tests.builders.diagnoses import a_data_set, a_diagnosis
from tests.builders.mesh_files import binary_stl
from tests.builders.scenes import a_series_file, a_walls_file, stored
from tests.builders.studies import a_finished_study


def paths_of(app: FastAPI) -> dict[str, set[str]]:
    """The methods of every path that the application answers."""
    found: dict[str, set[str]] = {}
    for route in _flat(app.routes):
        found.setdefault(route.path, set()).update(route.methods or ())
    return found


def _flat(routes: Iterable[BaseRoute]) -> Iterator[Route]:
    for route in routes:
        if isinstance(route, Route):
            yield route
        else:
            # FastAPI keeps an included router as it is (from 0.136 on). Anything else is to be named here first.
            router = route.original_router  # type: ignore[attr-defined]
            yield from _flat(router.routes)


def one_of_everything(database: Database, settings: Settings) -> dict[str, str]:
    """One of everything in the default project, by the name of its path parameter."""
    study_id = a_finished_study(database)
    (charge_id,) = charges(database)
    data_set = a_data_set(database)
    diagnosis = a_diagnosis(database, data_set)
    settings.artifacts_dir.mkdir(parents=True)
    (settings.artifacts_dir / "file").write_bytes(b"1")
    settings.geometries_dir.mkdir(parents=True, exist_ok=True)
    stl = binary_stl()
    (settings.geometries_dir / "a.stl").write_bytes(stl)
    with database.writing() as session:
        design = session.scalars(select(DesignRow).where(DesignRow.study_id == study_id)).first()
        assert design is not None
        keep_files(
            session,
            [StoredArtifact("picture", "a.png", "image/png", sha256(b"1").hexdigest(), 1, "file")],
            design_id=design.id,
        )
        design.results = {**(design.results or {}), "rig": {"base_diameter": 0.6}}
        folder = settings.artifacts_dir
        files = [
            stored(a_series_file(folder), "spheres", settings),
            stored(a_walls_file(folder), "walls", settings),
        ]
        keep_files(session, files, charge_id=charge_id)
        mesh = GeometryRow(
            file_name="a.stl",
            sha256=sha256(stl).hexdigest(),
            size_bytes=len(stl),
            triangles=1,
            extent={},
            path="a.stl",
        )
        size = {"value": 0.1, "unit": "1", "ci90": [0.0, 0.2]}
        claim = {"effect": library().effects[0].id, "inclusion": 0.99, "amplitude": size, "level": "claim"}
        session.get_one(DiagnosisRow, diagnosis).results = {"claims": [claim]}
        version = ModelVersionRow(name="baseline+x", diagnosis_id=diagnosis, base="x", effects={})
        session.add_all([mesh, version])
        session.flush()
        artifacts = {row.kind: row.id for row in session.scalars(select(ArtifactRow))}
        job = session.scalars(select(JobRow.id).where(JobRow.study_id == study_id)).first()
        return {
            name: str(value)
            for name, value in {
                "study_id": study_id,
                "design_id": design.id,
                "charge_id": charge_id,
                "data_set_id": data_set,
                "diagnosis_id": diagnosis,
                "version_id": version.id,
                "geometry_id": mesh.id,
                "artifact_id": artifacts["picture"],
                "scene_id": artifacts["spheres"],
                "walls_id": artifacts["walls"],
                "k": 0,
                "row": 0,
                "column": "speed",
                "job_id": job,
                "name": "pellet",
                "effect_id": library().effects[0].id,
                "claimed": library().effects[0].id,
                "folder": "x",
            }.items()
        }

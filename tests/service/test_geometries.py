"""Uploaded meshes: what is stored, what is refused, and what a charge may do with them."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from demcore.geometry.mesh_file import save_mesh
from demcore.plant.plant_file import load_plant
from demcore.plant.surfaces import deflector_mesh
from service.db.session import Database
from service.file_store import FolderStore
from service.studies.store_geometry import KeptMesh, keep_mesh, store_geometry
from tests.builders.databases import another_writer

HEADERS = {"Content-Type": "application/octet-stream"}


@pytest.fixture
def stl(tmp_path: Path) -> bytes:
    """The shipped deflector in millimetres."""
    path = tmp_path / "mine.stl"
    save_mesh(deflector_mesh(load_plant().deflector), path)
    return path.read_bytes()


def uploaded(client: TestClient, content: bytes, name: str = "mine.stl") -> Any:
    return client.post(f"/v1/geometries?file_name={name}", content=content, headers=HEADERS)


def charged(client: TestClient, part: str, row: dict[str, Any]) -> Any:
    return client.post("/v1/charges", json={"charge": "coke", "scale": 8.0, "plant": {part: row}})


def test_a_mesh_is_stored_once_and_stands_for_a_part(client: TestClient, stl: bytes) -> None:
    answer = uploaded(client, stl)
    assert answer.status_code == 201, answer.text
    assert answer.json()["triangles"] == 4
    assert answer.json()["extent"]["y"] == pytest.approx(900.0)
    assert uploaded(client, stl, "again.stl").json() == answer.json()
    assert client.get("/v1/geometries/1").json() == answer.json()
    assert client.get("/v1/geometries/2").status_code == 404
    made = charged(client, "deflector", {"geometry": 1, "units": "mm"})
    assert made.status_code == 201, made.text
    assert made.json()["items"][0]["spec"]["meshes"]["deflector"]["file_name"] == "mine.stl"


def test_a_mesh_is_read_before_the_write_lock_is_taken(
    client: TestClient, sqlite_database: Database, stl: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    def keep(*arguments: Any) -> KeptMesh:
        with another_writer(sqlite_database):
            return keep_mesh(*arguments)

    monkeypatch.setattr("service.api.geometries.keep_mesh", keep)
    assert uploaded(client, stl).status_code == 201


def test_the_same_mesh_from_several_at_once_is_one_geometry(
    database: Database, tmp_path: Path, stl: bytes
) -> None:
    mesh = keep_mesh(FolderStore(tmp_path / "geometries"), "mine.stl", stl)
    together = threading.Barrier(6)

    def store(_number: int) -> int:
        together.wait()
        with database.writing() as session:
            return store_geometry(session, mesh).id

    with ThreadPoolExecutor(6) as pool:
        assert len(set(pool.map(store, range(6)))) == 1


def test_millimetres_read_as_metres_are_refused_with_a_sentence(client: TestClient, stl: bytes) -> None:
    uploaded(client, stl)
    answer = charged(client, "deflector", {"geometry": 1, "units": "m"})
    assert answer.status_code == 422
    assert "is its unit another one?" in answer.json()["detail"]
    assert "m, mm, cm" in charged(client, "deflector", {"geometry": 1, "units": "feet"}).json()["detail"]
    assert "feeder.stl" in charged(client, "feeder", {"geometry": 1, "units": "mm"}).json()["detail"]


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [("mine.step", b"x", "ends in"), ("mine.stl", b"not a mesh", "geometry"), ("mine.stl", b"", "")],
)
def test_what_is_no_mesh_is_refused(client: TestClient, name: str, content: bytes, said: str) -> None:
    answer = uploaded(client, content, name)
    assert answer.status_code == 422
    assert said in answer.json()["detail"]

"""Pages of uploaded meshes: the list, a mesh with its size in every unit, and its triangles for the viewer."""

from __future__ import annotations

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select

from service.db.models import GeometryRow
from service.db.session import Database
from service.settings import Settings
from tests.builders.mesh_files import binary_stl
from tests.service.scene.test_packing import unpack


def upload(client: TestClient, name: str = "box.stl", content: bytes | None = None) -> int:
    answer = client.post(
        "/v1/geometries",
        params={"file_name": name},
        content=binary_stl() if content is None else content,
        headers={"Content-Type": "application/octet-stream"},
    )
    assert answer.status_code == 201, answer.text
    return int(answer.json()["id"])


def test_without_a_mesh_the_list_says_how_one_gets_there(client: TestClient) -> None:
    page = client.get("/geometries").text
    assert "No mesh yet" in page and "/v1/geometries?file_name=mine.stl" in page
    assert client.get("/v1/geometries").json() == {"items": [], "next_cursor": None}


def test_a_mesh_is_listed_by_page_and_api(client: TestClient) -> None:
    number = upload(client)
    text = client.get("/geometries").text
    assert f'href="/geometries/{number}"' in text and "1 × 2 × 3" in text and "watertight" in text
    assert [item["id"] for item in client.get("/v1/geometries").json()["items"]] == [number]
    assert client.get("/geometries/parts").json()["html"]["geometries"] in text
    assert "There are no older meshes" in client.get(f"/geometries?before={number}").text


def test_a_mesh_tells_its_size_in_every_unit_and_how_to_use_it(client: TestClient) -> None:
    text = client.get(f"/geometries/{upload(client)}").text
    # The box is 1 x 2 x 3 in its own unit: 3 mm are too small for a part of a plant, 3 m are not.
    assert "1 × 2 × 3 m" in text
    assert text.count(">unlikely<") == 1 and text.count(">possible<") == 3
    assert "talus charge coke --plant" in text


def test_the_viewer_gets_the_triangles_and_no_grains(client: TestClient) -> None:
    scene = client.get(f"/geometries/{upload(client)}/scene").json()
    assert scene["state"] == "ready" and scene["is_mesh"] is True
    (frame,) = scene["frames"]
    assert unpack(client.get(frame["url"]).content)[0]["grains"] == 0
    head, _ = unpack(client.get(frame["walls"]).content)
    assert head["triangles"] == 12 and head["high"] == pytest.approx([1.0, 2.0, 3.0])


def test_what_is_not_there_is_not_found(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    number = upload(client)
    for address in ("/geometries/99", "/geometries/x", "/geometries/99/scene", "/geometries/99/scene/walls"):
        assert client.get(address).status_code == 404, address
    with sqlite_database.reading() as session:
        row = session.scalars(select(GeometryRow)).one()
    (settings.geometries_dir / row.path).unlink()
    answer = client.get(f"/geometries/{number}/scene/walls")
    assert answer.status_code == 404 and "cannot be shown" in answer.json()["detail"]

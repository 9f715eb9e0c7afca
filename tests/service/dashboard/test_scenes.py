"""What the 3D viewer asks for: scenes in every state, frames, columns, one grain, tables."""

from __future__ import annotations

import csv
import io

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select

from service.db.models import ArtifactRow
from service.db.session import Database
from service.settings import Settings
from tests.builders import piles
from tests.builders.charges import charges, finish_charge
from tests.builders.scenes import (
    GRAINS,
    a_charge_under_way,
    a_charge_with_grains,
    a_design_with_grains,
    write_running_frames,
)
from tests.builders.studies import a_study, designs
from tests.service.scene.test_packing import unpack
from worker.evaluate import forget_checkpoint


def files(database: Database, kind: str) -> list[ArtifactRow]:
    with database.reading() as session:
        return list(session.scalars(select(ArtifactRow).where(ArtifactRow.kind == kind)))


def test_a_pile_is_drawn_with_its_base_and_says_what_is_not_stored(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    design = a_design_with_grains(sqlite_database, settings)
    scene = client.get(f"/designs/{design}/scene").json()
    assert scene["state"] == "ready" and scene["materials"] == {"0": "pellet"}
    assert [colour["name"] for colour in scene["colours"]] == ["height", "size", "material", "speed"]
    assert [one["label"] for one in scene["missing"]] == ["time of arrival", "time-lapse"]
    (frame,) = scene["frames"]
    assert frame["grains"] == GRAINS
    head, body = unpack(client.get(frame["url"]).content)
    assert head["grains"] == GRAINS and len(body) == 8 * GRAINS
    walls, _ = unpack(client.get(frame["walls"]).content)
    # The base of the pellet's rig is .6 m across, and its top is where the grains lie.
    assert walls["low"][0] == pytest.approx(-0.3) and walls["high"] == pytest.approx([0.3, 0.3, 0.0])
    assert walls["groups"][0]["solid"] is True
    assert client.get(f"{frame['url']}/grains/3").json()["speed_m_s"] == pytest.approx(0.003)
    table = client.get(f"{frame['url']}/table.csv")
    assert "attachment" in table.headers["content-disposition"]
    assert len(list(csv.DictReader(io.StringIO(table.text)))) == GRAINS
    assert f'data-scene="/designs/{design}/scene"' in client.get(f"/designs/{design}").text


def test_a_charge_is_drawn_over_time_with_its_walls(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    charge = a_charge_with_grains(sqlite_database, settings)
    scene = client.get(f"/charges/{charge}/scene").json()
    assert [(frame["time_s"], frame["grains"]) for frame in scene["frames"]] == [
        (0.0, 3),
        (2.0, 6),
        (4.0, 9),
        (6.0, 12),
    ]
    assert "arrival" in [colour["name"] for colour in scene["colours"]] and scene["missing"] == []
    assert "2 s apart" in scene["colours"][-1]["note"]
    assert unpack(client.get(scene["frames"][3]["walls"]).content)[0]["groups"][1]["wall"] == 1
    # In frame 2, at 4 s, three grains have come below the rim; those that come later are not known yet.
    head, body = unpack(client.get(f"{scene['frames'][2]['url']}/columns/arrival").content)
    assert head["range"] == [4.0, 4.0] and list(body) == [0, 0, 0] + [255] * 6
    head, _ = unpack(client.get(f"{scene['frames'][3]['url']}/columns/arrival").content)
    assert head["range"] == [4.0, 6.0]


def test_a_charge_without_a_series_is_drawn_at_its_end(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    charge = a_charge_with_grains(sqlite_database, settings, with_series=False)
    scene = client.get(f"/charges/{charge}/scene").json()
    assert len(scene["frames"]) == 1 and scene["frames"][0]["walls"] is None
    told = {one["label"] for one in scene["missing"]}
    assert told == {"time of arrival", "time-lapse", "hopper, bell, belt and deflector"}
    assert client.get(f"{scene['frames'][0]['url']}/columns/arrival").status_code == 404


def test_a_run_under_way_and_one_without_grains_say_so(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    searching = piles.a_searching_study(sqlite_database, settings)
    states = [
        client.get(f"/designs/{row.id}/scene").json()["state"] for row in designs(sqlite_database, searching)
    ]
    assert states == ["none", "none", "none", "none", "waiting"]
    (charge,) = charges(sqlite_database)
    assert client.get(f"/charges/{charge}/scene").json()["state"] == "waiting"


def test_a_charge_under_way_is_drawn_from_the_frames_that_its_run_has_written(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    charge, job = a_charge_under_way(sqlite_database, settings, frames=3)
    scene = client.get(f"/charges/{charge}/scene").json()
    assert scene["state"] == "ready" and scene["is_growing"] is True
    assert "4 s of simulated time" in scene["says"] and "2 s later" in scene["says"]
    assert [(frame["time_s"], frame["grains"]) for frame in scene["frames"]] == [(0.0, 0), (2.0, 3), (4.0, 6)]
    assert [one["label"] for one in scene["missing"]] == ["time of arrival"]
    last = scene["frames"][-1]
    head, body = unpack(client.get(last["url"]).content)
    assert head["grains"] == 6 and len(body) == 48
    assert unpack(client.get(last["walls"]).content)[0]["high"] == pytest.approx([1.0, 1.0, 1.0], abs=0.01)
    assert client.get(f"{last['url']}/grains/5").json()["number"] == 5
    assert len(client.get(f"{last['url']}/table.csv").text.splitlines()) == 7
    assert client.get(f"{last['url']}/columns/speed").status_code == 200
    assert client.get(f"{last['url']}/columns/arrival").status_code == 404
    # The page asks for the scene again when the frames have grown.
    before = client.get(f"/charges/{charge}/parts").json()
    write_running_frames(job, settings, frames=4, first=3)
    after = client.get(f"/charges/{charge}/parts").json()
    assert after["scene_size"] > before["scene_size"] > 0 and not after["has_scene"]
    assert len(client.get(f"/charges/{charge}/scene").json()["frames"]) == 4


def test_a_charge_under_way_says_when_there_is_something_to_see(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    (waiting,) = charges(sqlite_database)
    told = client.get(f"/charges/{waiting}/scene").json()
    assert told["state"] == "waiting" and "every 2 s of simulated time" in told["says"]
    (without,) = charges(sqlite_database, frame_seconds=None)
    told = client.get(f"/charges/{without}/scene").json()
    assert told["state"] == "waiting" and "No time series was asked for" in told["says"]
    assert client.get(f"/charges/{without}/parts").json()["scene_size"] == 0


def test_the_frames_of_a_charge_that_is_over_are_gone(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    charge, job = a_charge_under_way(sqlite_database, settings)
    url = client.get(f"/charges/{charge}/scene").json()["frames"][1]["url"]
    forget_checkpoint(job, settings)
    finish_charge(sqlite_database, charge, settings)
    assert client.get(f"/charges/{charge}/scene").json()["is_growing"] is False
    answer = client.get(url)
    assert answer.status_code == 404 and "under way" in answer.json()["detail"]


def test_removed_and_damaged_files_are_told_apart(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    design = a_design_with_grains(sqlite_database, settings)
    url = client.get(f"/designs/{design}/scene").json()["frames"][0]["url"]
    (file,) = files(sqlite_database, "vtkhdf")
    path = settings.artifacts_dir / file.path
    path.write_bytes(path.read_bytes()[:500])
    damaged = client.get(f"/designs/{design}/scene").json()
    assert damaged["state"] == "damaged" and "cannot be read" in damaged["says"]
    assert "cannot be read" in client.get(url).json()["detail"]
    path.unlink()
    removed = client.get(f"/designs/{design}/scene").json()
    assert removed["state"] == "removed" and "retention" in removed["says"]
    assert client.get(url).status_code == 404


NOT_THERE = (
    "/designs/999/scene",
    "/designs/999/scene/walls",
    "/charges/999/scene",
    "/designs/x/scene",
    "/scenes/999/frames/0",
    "/scenes/{pile}/frames/1",
    "/scenes/{pile}/frames/-1",
    "/scenes/{pile}/frames/x",
    "/scenes/{pile}/frames/99999999999999999999",
    "/scenes/{pile}/frames/0/grains/60",
    "/scenes/{pile}/frames/0/grains/x",
    "/scenes/{pile}/frames/0/columns/mass",
    "/scenes/{pile}/frames/7/table.csv",
    "/scenes/{pile}/walls/0",
    "/scenes/{picture}/frames/0",
    "/scenes/running-1/frames/0",
    "/scenes/running-x/frames/0",
    "/scenes/running-/walls/0",
)


def test_what_is_not_there_is_not_found(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    a_design_with_grains(sqlite_database, settings)
    (pile,), (picture,) = files(sqlite_database, "vtkhdf"), files(sqlite_database, "picture")
    for address in NOT_THERE:
        answer = client.get(address.format(pile=pile.id, picture=picture.id))
        assert answer.status_code == 404, address
        assert answer.headers["content-type"] == "application/problem+json", address


def test_a_study_without_a_rig_has_no_base(client: TestClient, sqlite_database: Database) -> None:
    study = a_study(sqlite_database, parallel=1)
    piles.start_next(sqlite_database, study)
    assert client.get(f"/designs/{designs(sqlite_database, study)[0].id}/scene/walls").status_code == 404

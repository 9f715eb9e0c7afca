"""POST /v1/charges/comparison and `talus compare`: the rows of the groups, the plant's heights, refusals."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import httpx
import pytest
from click.testing import CliRunner
from fastapi.testclient import TestClient

from service.cli import cli
from service.client import charge_comparison
from service.client.rest import Client
from service.db.session import Database
from service.studies.record_charge import record_charge
from tests.builders.charges import a_charge_measurement, charges, claimed_charge

HEIGHTS = "azimuth_deg,height_m\n45,1.0\n225,1.1\n135,0.5\n"


def finished(database: Database, *far: float) -> list[int]:
    """Charges whose far piles are so high."""
    ids = charges(database, seeds=tuple(range(len(far))))
    for number, height in zip(ids, far, strict=True):
        claim = claimed_charge(database, number)
        more: dict[str, Any] = {
            "findings": {"far_height_m": height},
            "sectors": {"azimuth_deg": [45.0, 135.0, 225.0, 315.0], "height": [-1.0, -1.5, -0.9, -1.0]},
            "inputs": {"plant": {"hopper": {"seat_depth": 2.0}}},
        }
        with database.writing() as session:
            assert record_charge(session, claim.lease, a_charge_measurement(**more))
    return ids


def test_two_groups_and_the_plant(client: TestClient, sqlite_database: Database) -> None:
    coke, iron = (finished(sqlite_database, *far) for far in ((1.4, 1.6), (1.0, 1.1)))
    answer = client.post(
        "/v1/charges/comparison",
        json={
            "groups": {"coke": coke, "iron": iron},
            "plant_heights": HEIGHTS,
            "plant_pressures": "azimuth_deg,pressure_kpa\n45,3\n135,1\n225,4\n315,2\n",
        },
    )
    assert answer.status_code == 200, answer.text
    found = answer.json()
    row = next(r for r in found["rows"] if r["name"] == "far_height_m")
    assert row["groups"]["coke"]["mean"] == pytest.approx(1.5)
    assert row["difference"] == pytest.approx(-0.45)
    assert row["stands_out"] is True
    assert [one["charge_id"] for one in found["plant"]] == [*coke, *iron]
    assert found["plant"][0]["rms_m"] == pytest.approx(0.0, abs=1e-12)
    assert [one["charge_id"] for one in found["pressures"]] == [*coke, *iron]
    # Heights 1.0, .5, 1.1, 1.0 against 3, 1, 4, 2: ranks 2.5, 1, 4, 2.5.
    assert found["pressures"][0]["rank_correlation"] == pytest.approx(4.5 / math.sqrt(4.5 * 5.0))
    assert found["pressures"][0]["as_strong_when_turned"] == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("body", "status", "said"),
    [
        ({"groups": {}}, 422, "groups of one charge or more"),
        ({"groups": {"a": []}}, 422, "groups of one charge or more"),
        ({"groups": {"a": [99]}}, 422, "groups.a: got 99, allowed is the id of a charge"),
        ({"groups": {"a": [-1]}}, 422, "the id of a charge"),
        ({"groups": {"a": [1]}}, 409, "Charge 1 has no results: it is WAITING"),
        ({"groups": {"a": [2]}, "plant_heights": "x\n1\n"}, 422, "columns azimuth_deg and height_m"),
        (
            {"groups": {"a": [2]}, "plant_pressures": "azimuth_deg,pressure_kpa\n1,2\n"},
            422,
            "at least 4 rows",
        ),
    ],
)
def test_refusals(
    client: TestClient, sqlite_database: Database, body: dict[str, Any], status: int, said: str
) -> None:
    charges(sqlite_database)
    finished(sqlite_database, 1.0)
    answer = client.post("/v1/charges/comparison", json=body)
    assert answer.status_code == status
    assert said in answer.json()["detail"]


def test_the_command_prints_the_table(
    client: TestClient, sqlite_database: Database, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    ids = finished(sqlite_database, 1.4, 1.6)
    transport = httpx.MockTransport(lambda request: pass_on(client, request))
    monkeypatch.setattr(
        charge_comparison, "Client", lambda url: Client("http://service", transport=transport)
    )
    out = tmp_path / "all.json"
    done = CliRunner().invoke(cli, ["compare", f"coke={ids[0]},{ids[1]}", "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "far_height_m" in done.output
    assert out.exists()
    assert CliRunner().invoke(cli, ["compare", "coke"]).exit_code == 2


def pass_on(client: TestClient, request: httpx.Request) -> httpx.Response:
    """What the application answers to the command's request."""
    answer = client.request(
        request.method, request.url.path, content=request.content, headers=request.headers
    )
    return httpx.Response(
        answer.status_code, content=answer.content, headers={"Content-Type": "application/json"}
    )

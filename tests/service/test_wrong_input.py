"""Wrong input is refused with 422 and a sentence that names field, value and limit; nothing is stored."""

from __future__ import annotations

import json
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import func, select

from service.db.models import EventRow, JobRow, StudyRow
from service.db.session import Database

PP = "particle_particle_static_friction"
FIXED = {"particle_wall_static_friction": 0.4, "particle_particle_restitution": 0.3}


def pellet(**changes: Any) -> dict[str, Any]:
    return {"material": "pellet", **changes}


# body, field, value as echoed, a part of what is allowed
WRONG = {
    "unknown material": ({"material": "sand"}, "material", "sand", "coke, sinter, pellet"),
    "no material": ({}, "material", None, "required"),
    "bounds reversed": (
        pellet(variables={PP: {"lower": 0.9, "upper": 0.1}}),
        f"variables.{PP}.lower",
        0.9,
        "less than its upper bound 0.1",
    ),
    "bound outside the model": (
        pellet(variables={PP: {"lower": -0.1}}),
        f"variables.{PP}.lower",
        -0.1,
        "0 to 2",
    ),
    "unknown variable": (pellet(variables={"mu": {}}), "variables.name", "mu", "rolling_resistance"),
    "no variable": (pellet(variables={}), "variables", "[]", "at least one"),
    "step wider than the range": (
        pellet(variables={PP: {"lower": 0.1, "upper": 0.2, "step": 0.5}}),
        f"variables.{PP}.step",
        0.5,
        "at most 0.1",
    ),
    "target 95 degrees": (
        pellet(objective={"target_deg": 95}),
        "objective.target_deg",
        95,
        "5 to 60 deg",
    ),
    "target outside the window": (
        pellet(objective={"target_deg": 30.0, "window_deg": [25.0, 26.0]}),
        "objective.target_deg",
        30.0,
        "25 to 26",
    ),
    "window reversed": (
        pellet(objective={"window_deg": [26.0, 25.0]}),
        "objective.window_deg",
        "[26.0, 25.0]",
        "lower bound below upper bound",
    ),
    "window of three": (
        pellet(objective={"window_deg": [25.0, 25.5, 26.0]}),
        "objective.window_deg",
        "[25.0, 25.5, 26.0]",
        "2 items",
    ),
    "tolerance 0": (pellet(objective={"tolerance_deg": 0}), "objective.tolerance_deg", 0, "more than 0"),
    "budget 0": (pellet(budget=0), "budget", 0, "1 to 1000"),
    "budget as text": (pellet(budget="30"), "budget", "30", "a whole number"),
    "budget with a fraction": (pellet(budget=10.5), "budget", 10.5, "a whole number"),
    "budget true": (pellet(budget=True), "budget", True, "a whole number"),
    "seed too large": (pellet(seed=2**31), "seed", 2**31, "2147483647"),
    "seed absurd": (pellet(seed=10**30), "seed", str(10**30), "2147483647"),
    "scale as text": (pellet(scale="2"), "scale", "2", "a number"),
    "scale 0": (pellet(scale=0), "scale", 0, "0.5 to 8"),
    "scale too large for the rig": ({"material": "coke", "scale": 7.0}, "scale", 7.0, "at most 5.9 for coke"),
    "unknown field": (pellet(colour="red"), "colour", "red", "no such field"),
    "unknown nested field": (
        pellet(objective={"target": 25.5}),
        "objective.target",
        25.5,
        "no such field",
    ),
    "fixed and searched": (
        pellet(variables={PP: {}}, fixed={PP: 0.5}),
        f"fixed.{PP}",
        0.5,
        "not also a variable",
    ),
    "fixed out of range": (
        pellet(fixed={"rolling_resistance": 9.0}),
        "fixed.rolling_resistance",
        9.0,
        "0 to 5",
    ),
    "unknown fixed": (pellet(fixed={"mu": 0.5}), "fixed", "mu", "rolling_resistance"),
    "unknown time step": (pellet(time_step="slow"), "time_step", "slow", "fast or paper"),
    "objective and responses": (
        pellet(objective={}, responses=[{"observable": "angle_deg"}]),
        "objective",
        "an objective as well",
        "one of",
    ),
    "no responses": (pellet(responses=[]), "responses", "[]", "at least 1"),
    "unknown observable": (
        pellet(responses=[{"observable": "colour"}]),
        "responses.observable",
        "colour",
        "mass_on_base_kg",
    ),
    "response without target": (
        pellet(responses=[{"observable": "mass_on_base_kg"}]),
        "responses.mass_on_base_kg.target",
        None,
        "required, in kg",
    ),
    "observable twice": (
        pellet(responses=[{"observable": "angle_deg"}, {"observable": "angle_deg"}]),
        "responses.observable",
        "angle_deg",
        "once",
    ),
    "tolerance under half the noise": (
        pellet(responses=[{"observable": "angle_deg", "tolerance": 0.2}]),
        "responses.angle_deg.tolerance",
        0.2,
        "half the noise between runs (0.5 deg, expected)",
    ),
    "window beside the target": (
        pellet(responses=[{"observable": "angle_deg", "target": 25.0, "window": [26.0, 27.0]}]),
        "responses.angle_deg.target",
        25.0,
        "inside the window 26 to 27",
    ),
    "unknown strategy": (pellet(strategy="luck"), "strategy", "luck", "sobol"),
    "budget under the factorial's": (
        pellet(strategy="factorial", budget=5),
        "budget",
        5,
        "at least 16 for the strategy factorial with 4 variables",
    ),
    "derived from nothing": (
        pellet(derived={"dynamic_friction_ratio": "0.9 * mu"}),
        "derived.dynamic_friction_ratio",
        "mu",
        "a searched, fixed or derived parameter",
    ),
    "derived as code": (
        pellet(derived={"dynamic_friction_ratio": "__import__('os')"}),
        "derived.dynamic_friction_ratio",
        "__import__('os')",
        "",
    ),
    "derived in a circle": (
        pellet(derived={"rolling_resistance": "rolling_resistance"}),
        "derived",
        "rolling_resistance -> rolling_resistance",
        "do not depend on themselves",
    ),
    "coarse but finer": (pellet(scale=4.0, coarse={"scale": 2.0}), "coarse.scale", 2.0, "more than"),
    "coarse beyond the rig": (
        {"material": "coke", "coarse": {"scale": 7.0}},
        "coarse.scale",
        7.0,
        "at most 5.9",
    ),
    "warm start from nowhere": (pellet(warm_start=[99]), "warm_start", 99, "a stored study"),
    "warm start twice": (pellet(warm_start=[1, 1]), "warm_start", 1, "each study once"),
    "a table for auto": (
        pellet(table_csv=f"{PP},rolling_resistance\n0.5,0.2\n", fixed=FIXED),
        "table",
        "1 rows without results",
        "strategy table",
    ),
    "a table and its text": (
        pellet(table=[{"x": {PP: 0.5}}], table_csv=PP),
        "table_csv",
        "a table as well",
        "one of",
    ),
    "a table without header": (pellet(table_csv=""), "table_csv", "nothing", "a header"),
    "a table with a strange column": (pellet(table_csv="mu\n1\n"), "table_csv.header", "mu", "a parameter"),
    "a table with words": (pellet(table_csv=f"{PP}\nmuch\n"), f"table_csv.2.{PP}", "much", "a finite number"),
    "a table with a short line": (
        pellet(table_csv=f"{PP},rolling_resistance\n0.5\n"),
        "table_csv.2",
        "1 cells",
        "2 cells",
    ),
    "a list": ([], "body", "[]", "an object"),
    "null": (None, "body", None, "required"),
}


def assert_refused(response: Any, field: str, value: Any, allowed: str) -> None:
    assert response.status_code == 422, response.text
    assert response.headers["content-type"] == "application/problem+json"
    body = response.json()
    (error,) = body["errors"]
    assert error["field"] == field
    assert error["value"] == value
    assert allowed in error["allowed"]
    assert field in body["detail"]
    assert allowed in body["detail"]


def assert_nothing_stored(database: Database) -> None:
    with database.reading() as session:
        for table in (StudyRow, JobRow, EventRow):
            assert session.scalar(select(func.count()).select_from(table)) == 0


@pytest.mark.parametrize("name", WRONG)
def test_wrong_study(client: TestClient, sqlite_database: Database, name: str) -> None:
    body, field, value, allowed = WRONG[name]
    assert_refused(client.post("/v1/studies", json=body), field, value, allowed)
    assert_nothing_stored(sqlite_database)


@pytest.mark.parametrize("literal", ["NaN", "Infinity", "-Infinity", "1e999"])
@pytest.mark.parametrize(
    ("text", "field"),
    [
        ('{"material": "pellet", "scale": %s}', "scale"),
        ('{"material": "pellet", "objective": {"target_deg": %s}}', "objective.target_deg"),
        ('{"material": "pellet", "fixed": {"rolling_resistance": %s}}', "fixed.rolling_resistance"),
        ('{"material": "pellet", "variables": {"rolling_resistance": {"lower": %s}}}', None),
    ],
)
def test_numbers_that_are_none(
    client: TestClient, sqlite_database: Database, text: str, field: str | None, literal: str
) -> None:
    field = field or "variables.rolling_resistance.lower"
    value = {"NaN": "nan", "-Infinity": "-inf"}.get(literal, "inf")
    response = client.post(
        "/v1/studies", content=text % literal, headers={"content-type": "application/json"}
    )
    assert_refused(response, field, value, "a finite number")
    assert_nothing_stored(sqlite_database)


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"not json", b"\xff\xfe\x00", b'{"material": "pel', b"[" * 100_000, b"1" * 5000],
    ids=["empty", "brace", "words", "bytes", "cut", "deep", "digits"],
)
def test_what_is_no_json_object(client: TestClient, sqlite_database: Database, content: bytes) -> None:
    response = client.post("/v1/studies", content=content, headers={"content-type": "application/json"})
    assert response.status_code == 422
    assert response.json()["errors"][0]["field"] == "body"
    assert_nothing_stored(sqlite_database)


def test_a_body_of_10_mb(client: TestClient, sqlite_database: Database) -> None:
    body = json.dumps(pellet(colour="x" * 10_000_000))
    response = client.post("/v1/studies", content=body, headers={"content-type": "application/json"})
    assert_refused(response, "body", f"{len(body)} bytes", "at most 1000000 bytes")
    assert_nothing_stored(sqlite_database)


def test_a_large_body_without_a_length(client: TestClient, sqlite_database: Database) -> None:
    chunks = (b" " * 100_000 for _ in range(20))
    response = client.post("/v1/studies", content=chunks, headers={"content-type": "application/json"})
    assert_refused(response, "body", "2000000 bytes", "at most 1000000 bytes")
    assert_nothing_stored(sqlite_database)


def test_a_long_value_is_not_echoed_whole(client: TestClient) -> None:
    response = client.post("/v1/studies", json={"material": "x" * 10_000})
    assert response.status_code == 422
    assert len(response.content) < 2_000


def test_a_lone_surrogate_is_answered_too(client: TestClient) -> None:
    content = b'{"material": "\\ud800"}'
    response = client.post("/v1/studies", content=content, headers={"content-type": "application/json"})
    assert_refused(response, "material", "?", "coke, sinter, pellet")


def test_every_wrong_field_is_named(client: TestClient) -> None:
    response = client.post("/v1/studies", json=pellet(budget="x", colour="red", scale="fine"))
    assert {error["field"] for error in response.json()["errors"]} == {"budget", "colour", "scale"}


@pytest.mark.parametrize(
    ("path", "field"),
    [
        ("/v1/studies/abc", "study_id"),
        ("/v1/studies/0", "study_id"),
        (f"/v1/studies/{2**63}", "study_id"),
        ("/v1/studies?limit=0", "limit"),
        ("/v1/studies?limit=201", "limit"),
        ("/v1/studies?cursor=-1", "cursor"),
        ("/v1/jobs?cursor=yesterday", "cursor"),
        ("/v1/jobs?cursor=nan_00000000-0000-0000-0000-000000000000", "cursor"),
        ("/v1/jobs?state=asleep", "state"),
        ("/v1/jobs/abc", "job_id"),
        (f"/v1/designs/{10**40}", "design_id"),
        ("/v1/artifacts/..%2f..%2fetc%2fpasswd", None),
    ],
)
def test_wrong_parameters(client: TestClient, path: str, field: str | None) -> None:
    response = client.get(path)
    assert response.headers["content-type"] == "application/problem+json"
    if field is None:
        assert response.status_code in (404, 422)
    else:
        assert response.status_code == 422
        assert response.json()["errors"][0]["field"] == field


@pytest.mark.parametrize("key", ["", " ", "with space", "x" * 201, "h\u00e4"])
def test_wrong_idempotency_key(client: TestClient, sqlite_database: Database, key: str) -> None:
    headers = {"Idempotency-Key": key.encode()}
    response = client.post("/v1/studies", json=pellet(), headers=headers)
    assert response.status_code == 422
    assert response.json()["errors"][0]["field"] == "idempotency-key"
    assert_nothing_stored(sqlite_database)

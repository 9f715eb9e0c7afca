"""POST /v1/charges: what it starts, what it says before, and the sentence of every refusal."""

from __future__ import annotations

from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.db.models import ChargeRow, ReportRow, StudyRow
from service.db.session import Database
from service.domain.search_space import default_space
from service.studies.give_back_job import Return, give_back_job
from service.studies.record_charge import record_charge
from tests.builders.charges import a_charge_measurement, charge, charges, claimed_charge, job_of_charge
from tests.builders.studies import a_study

FOUR = dict(zip(default_space().names, (0.5, 0.8, 0.24, 0.48), strict=True))

SHALLOW = {"rim_radius_mm": 1650.0, "cylinder_height_mm": 1.0, "seat_depth_mm": 1450.0}


def posted(client: TestClient, **body: Any) -> dict[str, Any]:
    answer = client.post("/v1/charges", json={"charge": "coke", "scale": 8.0, **body})
    assert answer.status_code == 201, answer.text
    found: dict[str, Any] = answer.json()
    return found


def refusal(client: TestClient, **body: Any) -> str:
    answer = client.post("/v1/charges", json={"charge": "coke", "scale": 8.0, **body})
    assert answer.status_code == 422, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert client.get("/v1/charges").json()["items"] == []
    return str(answer.json()["detail"])


def test_a_charge_is_stored_with_its_job_and_its_cost(client: TestClient) -> None:
    answer = posted(client)
    (item,) = answer["items"]
    assert item["state"] == "WAITING"
    assert item["parameters_from"] == "paper, Table 5"
    assert item["cost"]["particles"] == pytest.approx(800, rel=0.02)
    assert "no charge has run here yet" in item["cost"]["text"]
    assert answer["seconds"] == item["cost"]["seconds"]
    job = client.get(f"/v1/jobs/{item['job_id']}").json()
    assert (job["kind"], job["state"], job["study_id"], job["charge_id"]) == ("charge", "queued", None, 1)
    assert client.get("/v1/charges/1").json() == item
    assert client.get("/v1/charges/1/summary").status_code == 409
    assert client.get("/v1/charges/2").status_code == 404


def test_each_seed_is_a_charge_of_one_series(client: TestClient) -> None:
    assert [item["seed"] for item in posted(client, seeds=[3, 1, 2])["items"]] == [3, 1, 2]
    posted(client)
    listed = client.get("/v1/charges?series=1&limit=2").json()
    assert [item["id"] for item in listed["items"]] == [3, 2]
    rest = client.get(f"/v1/charges?series=1&cursor={listed['next_cursor']}").json()
    assert [item["id"] for item in rest["items"]] == [1]
    assert rest["next_cursor"] is None


def test_a_charge_that_would_take_days_says_so_before_it_starts(client: TestClient) -> None:
    refused = client.post("/v1/charges", json={"charge": "iron", "scale": 1.0})
    assert refused.status_code == 422
    (error,) = refused.json()["errors"]
    assert error["field"] == "longest_hours" and error["value"] == 24.0
    assert "THAT IS DAYS" in error["allowed"]
    assert client.get("/v1/charges").json()["items"] == []
    (item,) = posted(client, charge="iron", scale=1.0, longest_hours=8760.0)["items"]
    assert item["cost"]["seconds"] > 86_400.0


@pytest.mark.parametrize("hours", [0.0, -1.0, 8761.0])
def test_hours_that_no_charge_may_take_are_refused(client: TestClient, hours: float) -> None:
    answer = client.post("/v1/charges", json={"charge": "coke", "longest_hours": hours})
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == "longest_hours"


def test_what_is_short_enough_by_a_hair_is_taken_and_the_estimate_is_refused_alike(
    client: TestClient,
) -> None:
    body = {"charge": "coke", "scale": 8.0}
    hours = client.post("/v1/charges/estimate", json=body).json()["seconds"] / 3600.0
    short = client.post("/v1/charges/estimate", json=body | {"longest_hours": 0.999 * hours})
    assert short.status_code == 422 and short.json()["errors"][0]["field"] == "longest_hours"
    assert posted(client, **body, longest_hours=1.001 * hours)["items"][0]["scale"] == 8.0


def test_the_next_charge_is_told_by_the_rate_of_the_last(
    client: TestClient, sqlite_database: Database
) -> None:
    (first,) = charges(sqlite_database)
    claim = claimed_charge(sqlite_database, first)
    with sqlite_database.writing() as session:
        assert record_charge(session, claim.lease, a_charge_measurement(particle_steps=1e9, wall_s=500.0))
    (item,) = posted(client)["items"]
    assert f"as charge {first} ran here" in item["cost"]["text"]
    assert item["cost"]["seconds"] == pytest.approx(item["cost"]["particle_steps"] / 2e6)


def test_a_charge_that_was_interrupted_counts_its_time_from_its_first_start(
    sqlite_database: Database,
) -> None:
    (number,) = charges(sqlite_database)
    first = claimed_charge(sqlite_database, number)
    with sqlite_database.writing() as session:
        session.get_one(ChargeRow, number).started_at = 1000.0
        assert give_back_job(session, first.lease, Return("released", "the service was stopped"))
    claimed_charge(sqlite_database, number)
    assert charge(sqlite_database, number).started_at == 1000.0


def test_the_same_key_gives_the_same_charges_and_another_request_is_refused(client: TestClient) -> None:
    body, key = {"charge": "coke", "scale": 8.0, "seeds": [1, 2]}, {"Idempotency-Key": "k1"}
    first, again = (client.post("/v1/charges", json=body, headers=key) for _ in range(2))
    assert first.json() == again.json()
    other = client.post("/v1/charges", json=body | {"seeds": [5]}, headers=key)
    assert other.status_code == 422
    assert "belongs to charge 1" in other.json()["detail"]
    assert len(client.get("/v1/charges").json()["items"]) == 2


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ({"charge": "granite"}, "charge: got 'granite', allowed is one of coke, iron"),
        ({"scale": 0.0}, "scale: got 0.0"),
        ({"scale": 30.0}, "scale: got 30.0, allowed is 0.1 to 20"),
        ({"seeds": []}, "seeds"),
        ({"seeds": [1, 1]}, "at least one, each once"),
        ({"seeds": [-1]}, "seed: got -1"),
        ({"rest_seconds": -1.0}, "rest_seconds"),
        ({"frame_seconds": 0.0}, "frame_seconds"),
        ({"speed": 3}, "no such field"),
        ({"plant": {"belt": {"speed_m_s": 4.0}}}, "belt.speed: got 4.0, allowed is a jet through the hatch"),
        (
            {"plant": {"feeder": {"drop_mm": 50.0}}},
            "feeder.drop: got 0.05, allowed is an inlet clear of walls",
        ),
        (
            {
                "charge": "iron",
                "plant": {
                    "hopper": {"rim_radius_mm": 1650.0, "cylinder_height_mm": 1.0, "seat_depth_mm": 1450.0}
                },
            },
            "charge.mass: got 12483.333, allowed is at most",
        ),
        ({"plant": {"belt": {"speed": 4.0}}}, "belt.speed: got 4.0, allowed is speed_m_s"),
        ({"plant": {"chimney": {"height_mm": 4.0}}}, "plant.chimney"),
        ({"plant": {"deflector": {"ridge_across_mm": "left"}}}, "deflector.ridge_across_mm: got 'left'"),
        ({"plant": {"deflector": {"geometry": 7, "units": "mm"}}}, "the id of an uploaded geometry"),
        ({"plant": {"deflector": {"geometry": 7}}}, "a mesh does not say its own"),
        ({"parameters": {"coke": {}}}, "either values or a study"),
        ({"parameters": {"coke": {"values": FOUR, "study": 1}}}, "either values or a study"),
        ({"parameters": {"coal": {"values": FOUR}}}, "parameters: got 'coal', allowed is one of all, coke"),
        ({"parameters": {"coke": {"values": {"rolling_resistance": 0.2}}}}, "static_friction: got None"),
        (
            {"parameters": {"coke": {"values": FOUR | {"stickiness": 1.0}}}},
            "parameters.coke.stickiness: got 1.0, allowed is one of",
        ),
        (
            {"parameters": {"coke": {"values": FOUR | {"rolling_resistance": -1.0}}}},
            "rolling_resistance: got -1.0",
        ),
        (
            {"parameters": {"coke": {"values": FOUR}, "all": {"values": FOUR}}},
            "all alone, or sets by material",
        ),
        (
            {"parameters": {"coke": {"study": 99}}},
            "parameters.coke.study: got 99, allowed is the id of a study",
        ),
    ],
)
def test_what_cannot_be_charged_is_refused_before_anything_is_stored(
    client: TestClient, body: dict[str, Any], said: str
) -> None:
    assert said in refusal(client, **body)


def test_contact_numbers_come_from_a_studys_recommendation(
    client: TestClient, sqlite_database: Database
) -> None:
    study_id = a_study(sqlite_database, material="coke")
    assert "has recommended an optimum" in refusal(client, parameters={"coke": {"study": study_id}})
    pellet = a_study(sqlite_database)
    assert "a study of coke: this one is of pellet" in refusal(client, parameters={"coke": {"study": pellet}})
    with sqlite_database.writing() as session:
        session.get_one(StudyRow, study_id).recommendation = {"x": FOUR}
    (item,) = posted(client, parameters={"coke": {"study": study_id}})["items"]
    assert item["spec"]["parameters"] == {"coke": FOUR}
    assert item["parameters_from"] == f"coke: recommended by study {study_id}"


def test_an_ensemble_is_a_charge_for_each_member_and_seed(
    client: TestClient, sqlite_database: Database
) -> None:
    sinter, pellet = (a_study(sqlite_database, material=name) for name in ("sinter", "pellet"))
    members = [{"x": {**FOUR, "rolling_resistance": n / 10}} for n in (2, 3, 4)]
    asked = {"sinter": {"study": sinter, "members": 3}, "pellet": {"study": pellet, "members": 3}}
    assert "has 3 members: it has 0" in refusal(client, charge="iron", parameters=asked)
    with sqlite_database.writing() as session:
        for study_id in (sinter, pellet):
            content = {"ensemble": {"members": members}}
            session.add(ReportRow(study_id=study_id, designs=3, content=content))
    uneven = {"sinter": {"study": sinter, "members": 3}, "pellet": {"study": pellet, "members": 2}}
    assert "the same number for all materials" in refusal(client, charge="iron", parameters=uneven)
    items = posted(client, charge="iron", parameters=asked, seeds=[1, 2])["items"]
    assert len(items) == 6
    rolling = [item["spec"]["parameters"]["pellet"]["rolling_resistance"] for item in items]
    assert rolling == [0.2, 0.2, 0.3, 0.3, 0.4, 0.4]
    assert f"pellet: member 3 of the ensemble of study {pellet}" in items[-1]["parameters_from"]


def test_a_queued_charge_is_cancelled_and_a_finished_one_is_not(
    client: TestClient, sqlite_database: Database
) -> None:
    first, second = charges(sqlite_database, seeds=(1, 2))
    assert client.post(f"/v1/charges/{first}/cancel").json()["state"] == "CANCELLED"
    assert job_of_charge(sqlite_database, first).state.value == "cancelled"
    claim = claimed_charge(sqlite_database, second)
    with sqlite_database.writing() as session:
        assert record_charge(session, claim.lease, a_charge_measurement())
    assert client.post(f"/v1/charges/{second}/cancel").status_code == 409
    assert charge(sqlite_database, second).state.value == "COMPLETE"
    assert client.get(f"/v1/charges/{second}/summary").json()["summary"]["in_hopper_kg"] == 2990.0
    assert client.get(f"/v1/charges/{second}").json()["findings"] == {"piles": 2}

"""Measured data in, diagnoses asked for: what is stored and said before, and the sentence of every refusal."""

from __future__ import annotations

from typing import Any

import pytest
from fastapi.testclient import TestClient

from tests.builders.diagnoses import CONDITIONS, MASSES, OBSERVATIONS, tables


def uploaded(client: TestClient, texts: dict[str, str] | None = None) -> dict[str, Any]:
    answer = client.post("/v1/measurements", json={"name": "lab", "tables": texts or tables()})
    assert answer.status_code in (200, 201), answer.text
    found: dict[str, Any] = answer.json()
    return found


def refused(client: TestClient, path: str, body: dict[str, Any]) -> dict[str, Any]:
    answer = client.post(path, json=body)
    assert answer.status_code == 422, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    found: dict[str, Any] = answer.json()
    return found


def test_a_data_set_is_stored_once(client: TestClient) -> None:
    first = uploaded(client)
    assert first["can_be_diagnosed"] is True
    assert [(c["condition"], c["holdout"], c["replicates"]) for c in first["conditions"]] == [
        (name, name == "held", 3) for name in MASSES
    ]
    assert (first["observations"], first["opened_by"]) == (24, None)
    again = client.post("/v1/measurements", json={"name": "other", "tables": tables()})
    assert again.status_code == 200
    assert again.json() == first
    assert client.get("/v1/measurements/1").json() == first
    assert client.get("/v1/measurements").json()["items"] == [first]


def test_what_is_held_out_is_part_of_the_data_set(client: TestClient) -> None:
    one, other = uploaded(client), uploaded(client, tables(held=("small",)))
    assert one["id"] != other["id"]
    assert one["split_hash"] != other["split_hash"]


def test_every_bad_cell_is_named(client: TestClient) -> None:
    texts = tables()
    texts[CONDITIONS] = texts[CONDITIONS].replace("pellet,45", "pellet,-45")
    texts[OBSERVATIONS] = texts[OBSERVATIONS].replace("small,r1,repose_angle_deg", "small,r1,repose_angel")
    found = refused(client, "/v1/measurements", {"name": "lab", "tables": texts})
    fields = [error["field"] for error in found["errors"]]
    assert "tables.conditions.csv[3].mass_kg" in fields
    assert "tables.observations.csv[2].observable" in fields
    assert client.get("/v1/measurements").json()["items"] == []


@pytest.mark.parametrize(
    ("texts", "field"),
    [
        ({CONDITIONS: tables()[CONDITIONS]}, "tables.observations.csv"),
        ({**tables(), "notes.csv": "a,b\n"}, "tables.notes.csv"),
        ({CONDITIONS: "", OBSERVATIONS: ""}, "tables.conditions.csv"),
    ],
)
def test_the_tables_are_those_of_the_format(client: TestClient, texts: dict[str, str], field: str) -> None:
    found = refused(client, "/v1/measurements", {"name": "lab", "tables": texts})
    assert any(error["field"].startswith(field) for error in found["errors"])


def test_data_that_are_too_thin_are_kept_and_not_diagnosed(client: TestClient) -> None:
    stored = uploaded(client, tables(replicates=2))
    assert stored["can_be_diagnosed"] is False
    assert "fewer than 3 replicates" in stored["sentences"][0]
    found = refused(client, "/v1/diagnoses", {"data_set": stored["id"]})
    assert "Two runs do not tell how far runs scatter" in found["detail"]


def test_without_a_held_out_condition_it_says_what_is_lost(client: TestClient) -> None:
    stored = uploaded(client, tables(held=()))
    assert stored["can_be_diagnosed"] is True
    assert "No held-out condition" in stored["sentences"][0]


def test_a_diagnosis_is_stored_with_its_job_and_its_cost(client: TestClient) -> None:
    uploaded(client)
    answer = client.post("/v1/diagnoses", json={"data_set": 1, "grains": 300})
    assert answer.status_code == 201, answer.text
    found = answer.json()
    assert (found["state"], found["verdict"], found["result"]) == ("WAITING", None, None)
    assert "pile tests" in found["cost"]["text"]
    job = client.get(f"/v1/jobs/{found['job_id']}").json()
    assert (job["kind"], job["state"], job["study_id"], job["diagnosis_id"]) == (
        "diagnose",
        "queued",
        None,
        1,
    )
    assert client.get("/v1/diagnoses/1").json() == found
    assert client.get("/v1/diagnoses?data_set=1").json()["items"] == [found]
    assert client.get("/v1/diagnoses?data_set=2").json()["items"] == []
    assert client.get("/v1/diagnoses/2").status_code == 404


def test_a_larger_pile_costs_more(client: TestClient) -> None:
    uploaded(client)
    hours = [
        client.post("/v1/diagnoses", json={"data_set": 1, "grains": n}).json()["cost"]["hours"]
        for n in (300, 600, 2400)
    ]
    assert hours[0] < hours[1] < hours[2]


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({"data_set": 9}, "data_set"),
        ({"data_set": 1, "grains": 10}, "grains"),
        ({"data_set": 1, "plants": 50}, "plants"),
        ({"data_set": 1, "contact_model": "hooke"}, "contact_model"),
        ({"data_set": 1, "first_wave": 1}, "first_wave"),
        ({"data_set": 1, "seed": -1}, "seed"),
        ({"data_set": 1, "colour": "red"}, "colour"),
    ],
)
def test_a_wrong_request_names_its_field(client: TestClient, body: dict[str, Any], field: str) -> None:
    uploaded(client)
    found = refused(client, "/v1/diagnoses", body)
    assert found["errors"][0]["field"].endswith(field)
    assert client.get("/v1/diagnoses").json()["items"] == []


@pytest.mark.parametrize(
    ("texts", "why"),
    [
        (tables(masses={"a": 20.0, "b": 500.0}, held=()), "what the cylinder holds"),
        (tables(cylinder_diameter_m="2.0"), "cylinder_diameter"),
        ({k: v.replace("pellet", "lime") for k, v in tables().items()}, "'lime' is none of"),
        (tables(psd="0.4:1"), "scale"),
    ],
)
def test_a_condition_that_the_model_cannot_make_is_named(
    client: TestClient, texts: dict[str, str], why: str
) -> None:
    """At the upload, so that nobody waits for a diagnosis which is then refused."""
    stored = uploaded(client, texts)
    assert stored["can_be_diagnosed"] is False
    assert any(s.startswith("Refused") and why in s for s in stored["sentences"])
    found = refused(client, "/v1/diagnoses", {"data_set": stored["id"]})
    assert why in found["detail"]


def test_charges_are_kept_and_not_diagnosed(client: TestClient) -> None:
    head = "condition,test,material,mass_kg"
    observed = [f"c{c},{i},belt_depth_m,0.{12 + c + i}" for c in (1, 2) for i in range(3)]
    texts = {
        CONDITIONS: f"{head}\nc1,charge,sinter,3000\nc2,charge,sinter,5000\n",
        OBSERVATIONS: "\n".join(
            ["condition,replicate,observable,value,unit", *[f"{row},m" for row in observed]]
        ),
    }
    stored = uploaded(client, texts)
    assert stored["can_be_diagnosed"] is False
    assert stored["sentences"][-1] == "Refused, c1, c2: only pile tests are simulated by this model."
    assert "only pile tests" in refused(client, "/v1/diagnoses", {"data_set": stored["id"]})["detail"]


def test_grains_that_need_a_finer_pile_are_told(client: TestClient) -> None:
    """Too coarse by default, and diagnosed with more grains."""
    texts = tables(masses={"a": 2000.0, "b": 2400.0, "c": 3000.0}, held=())
    texts[CONDITIONS] = texts[CONDITIONS].replace("pellet", "sinter")
    stored = uploaded(client, texts)
    assert stored["can_be_diagnosed"] is True
    assert stored["sentences"][-1].startswith(
        "With the 600 grains of a usual pile, c cannot be simulated: scale"
    )
    assert "scale" in refused(client, "/v1/diagnoses", {"data_set": stored["id"]})["detail"]
    finer = {"data_set": stored["id"], "grains": 2000}
    assert client.post("/v1/diagnoses", json=finer).status_code == 201


def test_the_same_key_is_one_diagnosis(client: TestClient) -> None:
    uploaded(client)
    key = {"Idempotency-Key": "monday"}
    first, again = (client.post("/v1/diagnoses", json={"data_set": 1}, headers=key) for _ in range(2))
    assert first.json() == again.json()
    other = client.post("/v1/diagnoses", json={"data_set": 1, "seed": 2}, headers=key)
    assert other.status_code == 422
    assert "Idempotency-Key" in other.json()["detail"]


def test_a_queued_diagnosis_is_cancelled_at_once(client: TestClient) -> None:
    uploaded(client)
    made = client.post("/v1/diagnoses", json={"data_set": 1}).json()
    answer = client.post("/v1/diagnoses/1/cancel")
    assert (answer.status_code, answer.json()["state"]) == (202, "CANCELLED")
    assert client.get(f"/v1/jobs/{made['job_id']}").json()["state"] == "cancelled"
    assert client.post("/v1/diagnoses/2/cancel").status_code == 404


def test_no_model_version_and_nothing_to_withdraw(client: TestClient) -> None:
    assert client.get("/v1/model-versions").json() == {"items": [], "next_cursor": None}
    assert client.post("/v1/model-versions/1/withdraw").status_code == 404


def planned(client: TestClient, **more: str) -> int:
    """The id of conditions that nobody has measured."""
    body = {"name": "plan", "tables": {CONDITIONS: tables(**more)[CONDITIONS]}, "planned": True}
    answer = client.post("/v1/measurements", json=body)
    assert answer.status_code == 201, answer.text
    found = answer.json()
    assert found["can_be_diagnosed"] is False
    assert "ask what these tests could show" in found["sentences"][0]
    number: int = found["id"]
    return number


def test_conditions_alone_are_planned_and_not_diagnosed(client: TestClient) -> None:
    number = planned(client)
    assert "Nothing is measured yet" in refused(client, "/v1/diagnoses", {"data_set": number})["detail"]
    plan = {"replicates": 5, "candidates": ["held"], "observables": ["repose_angle_deg", "profiles"]}
    made = client.post("/v1/diagnoses", json={"data_set": number, "plan": plan}).json()
    assert made["spec"]["plan"] == plan
    whole = client.post("/v1/diagnoses", json={"data_set": uploaded(client)["id"]}).json()
    assert "plan" not in whole["spec"]
    assert made["cost"]["runs"] < whole["cost"]["runs"]


@pytest.mark.parametrize(
    ("plan", "field", "allowed"),
    [
        ({"replicates": 2}, "plan.replicates", "from 3 to 100"),
        ({"replicates": 0}, "plan.replicates", "from 3 to 100"),
        ({"observables": ["angle"]}, "plan.observables", "repose_angle_deg"),
        ({"observables": ["belt_depth_m"]}, "plan.observables", "condition small gives: repose_angle_deg"),
        ({"observables": ["profiles", "profiles"]}, "plan.observables", "once"),
        ({"candidates": ["nobody"]}, "plan.candidates", "small, middle, large, held"),
        ({"candidates": list(MASSES)}, "plan.candidates", "without them"),
        ({"colour": "red"}, "plan.colour", ""),
    ],
)
def test_a_wrong_plan_names_its_field(
    client: TestClient, plan: dict[str, Any], field: str, allowed: str
) -> None:
    found = refused(client, "/v1/diagnoses", {"data_set": planned(client), "plan": plan})
    assert found["errors"][0]["field"].endswith(field)
    assert allowed in found["detail"]


def test_profiles_without_observations_are_no_plan(client: TestClient) -> None:
    texts = {CONDITIONS: tables()[CONDITIONS], "profiles.csv": "condition,replicate,theta_deg,r_m,h_m\n"}
    found = refused(client, "/v1/measurements", {"name": "x", "tables": texts, "planned": True})
    assert found["errors"][0]["field"] == "tables.observations.csv"

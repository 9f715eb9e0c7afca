"""A study that is simulated with a version of the model: what is stored, what is simulated, what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from demcore.experiments import charge_effects
from demcore.experiments.pile_effects import with_effects
from service.db.models import ModelVersionRow, StudyRow
from service.db.session import Database
from service.domain.charge import ChargeSpec, charge_test
from service.domain.diagnosis import DiagnosisOutcome, DiagnosisSpec, Extension
from service.domain.spec_record import spec_from_record, spec_to_record
from service.studies.claim_job import DiagnosisClaim, claim_job
from service.studies.record_diagnosis import record_diagnosis
from tests.builders.diagnoses import a_data_set, a_diagnosis, job_of_diagnosis, tables
from worker.charge_report import command_of
from worker.evaluate import test_of as pile_of

# Of 40 kg in some 400 grains of pellet, which makes them 2.6 times coarser.
SCALE = 2.5
# What the materials' cylinders hold a good part of, kg; one condition is held out.
MASSES = {
    "pellet": {"small": 20.0, "middle": 45.0, "held": 60.0},
    "coke": {"small": 250.0, "middle": 350.0, "held": 450.0},
}


@pytest.fixture
def database(sqlite_database: Database) -> Database:
    """The client's."""
    return sqlite_database


def a_version(
    database: Database,
    effects: dict[str, float],
    contact_model: str = "paper",
    withdrawn: bool = False,
    material: str = "pellet",
    along: dict[str, dict[str, float]] | None = None,
) -> str:
    """The name of a version that a diagnosis of such piles would have made."""
    texts = {name: text.replace("pellet", material) for name, text in tables(masses=MASSES[material]).items()}
    data = a_data_set(database, texts)
    asked = a_diagnosis(database, data, grains=400, contact_model=contact_model)
    name = "+".join(["baseline", *effects])
    row = ModelVersionRow(
        name=name,
        diagnosis_id=asked,
        base="demcore-paper-400",
        effects={
            key: {
                "value": value,
                "unit": "1",
                "ci90": [0.0, 2.0 * value],
                **({"along": along[key]} if along and key in along else {}),
            }
            for key, value in effects.items()
        },
        withdrawn_at=1.7e9 if withdrawn else None,
    )
    with database.writing() as session:
        session.add(row)
    return name


def asked(client: TestClient, version: str, **body: Any) -> Any:
    return client.post(
        "/v1/studies", json={"material": "pellet", "scale": SCALE, "model_version": version, **body}
    )


def test_its_effects_are_stored_and_simulated(client: TestClient, database: Database) -> None:
    version = a_version(database, {"vibration": 0.3, "density": 0.05})
    answer = asked(client, version)
    assert answer.status_code == 201, answer.text
    stored = answer.json()["spec"]["model"]
    assert stored == {
        "name": version,
        "moisture_percent": 0.0,
        "effects": {"vibration": 0.3, "density": 0.05},
    }
    spec = spec_from_record(answer.json()["spec"])
    assert spec_to_record(spec) == answer.json()["spec"]
    middle = tuple(0.5 * (v.lower + v.upper) for v in spec.space.variables)
    plain = pile_of(spec_from_record({**answer.json()["spec"], "model": None}), middle, SCALE)
    assert pile_of(spec, middle, SCALE) == with_effects(plain, {"vibration": 0.3, "density": 0.05}) != plain


def test_it_is_another_space_than_the_baselines(client: TestClient, database: Database) -> None:
    version = a_version(database, {"vibration": 0.3})
    numbers = [asked(client, version).json()["id"]]
    numbers.append(client.post("/v1/studies", json={"material": "pellet", "scale": SCALE}).json()["id"])
    with database.reading() as session:
        hashes = [session.get_one(StudyRow, number).space_hash for number in numbers]
    assert hashes[0] != hashes[1]


def test_cohesion_acts_in_proportion_to_the_water(client: TestClient, database: Database) -> None:
    version = a_version(database, {"cohesion": 0.8})
    wet = asked(client, version, moisture_percent=2.0).json()["spec"]["model"]
    assert wet["effects"] == {"cohesion": pytest.approx(0.4)}  # stated at 4 %
    dry = asked(client, version)
    assert dry.status_code == 422
    assert "cohesion has nothing to act on there (state its moisture_percent)" in dry.json()["detail"]


@pytest.mark.parametrize(
    ("effects", "more", "body", "sentence"),
    [
        ({"density": 0.1}, {"withdrawn": True}, {}, "this one was withdrawn on 2023-11-14"),
        ({"density": 0.1}, {}, {"material": "coke"}, "this one was found on pellet"),
        ({"density": 0.1}, {}, {"scale": 0.8}, "this one holds from"),
        ({"density": 0.1}, {"contact_model": "hertz_mindlin"}, {}, "found with hertz_mindlin contacts"),
        ({"weigh_gain": 0.1}, {}, {}, "weigh_gain is a fault of the measurement, so correct that"),
        ({"belt_speed": 0.1}, {}, {}, "belt_speed is none"),
        ({"lift_speed": 0.3}, {}, {}, "lift_speed has nothing to act on there"),
        ({"feed_offcentre": 0.5}, {}, {}, "the cylinder stands on the base"),
    ],
)
def test_a_version_that_does_not_fit_is_refused_in_one_sentence(
    client: TestClient,
    database: Database,
    effects: dict[str, float],
    more: dict[str, Any],
    body: dict[str, Any],
    sentence: str,
) -> None:
    answer = asked(client, a_version(database, effects, **more), **body)
    assert answer.status_code == 422
    assert sentence in answer.json()["detail"]
    assert client.get("/v1/studies").json()["items"] == []


def test_a_name_that_no_version_has(client: TestClient) -> None:
    answer = asked(client, "baseline+ghost")
    assert answer.json()["errors"][0]["field"] == "model_version"
    wet = client.post("/v1/studies", json={"material": "pellet", "moisture_percent": 3.0})
    assert "0 without a model_version" in wet.json()["detail"]


def test_a_warm_start_needs_the_same_model(client: TestClient, database: Database) -> None:
    version = a_version(database, {"vibration": 0.3})
    number = asked(client, version).json()["id"]
    client.post(f"/v1/studies/{number}/cancel")
    answer = client.post("/v1/studies", json={"material": "pellet", "scale": SCALE, "warm_start": [number]})
    assert "its model is baseline+vibration, here it is the baseline" in answer.json()["detail"]


def test_the_library_is_told_with_what_makes_each_effect(client: TestClient) -> None:
    found = client.get("/v1/effects").json()
    made = {effect["id"]: effect["made_by"] for effect in found["items"]}
    assert len(made) == 23 and len(found["self_tests"]) == 4
    assert {name for name, by in made.items() if by == "reading"} == {
        "sensor_offset",
        "sensor_tilt",
        "weigh_gain",
        "sample_bias",
    }
    assert made["cohesion"] == "simulation" and made["belt_speed"] == "charge"
    cohesion = client.get("/v1/effects/cohesion").json()
    assert cohesion["scope"] == [{"moisture_percent": {"above": 0.0}}]
    assert (cohesion["lowest"], cohesion["highest"], cohesion["prior_scale"]) == (0.0, 2.0, 0.4)
    lift = client.get("/v1/effects/lift_speed").json()["scope"]
    assert lift == [{"test": "pile", "removal": "lift"}]
    missing = client.get("/v1/effects/magic")
    assert missing.status_code == 404 and "cohesion" in missing.json()["detail"]


def charged(client: TestClient, version: str, **body: Any) -> Any:
    return client.post("/v1/charges", json={"charge": "coke", "scale": 4.0, "model_version": version, **body})


def test_a_charge_is_simulated_with_a_version(client: TestClient, database: Database, tmp_path: Path) -> None:
    """The lab's base and the plant's liner are one statement; the water is that of the burden."""
    effects = {"density": 0.05, "base_rough": 0.1, "cohesion": 0.4}
    version = a_version(database, effects, material="coke")
    answer = charged(client, version, moisture_percent=2.0)
    assert answer.status_code == 201, answer.text
    record = answer.json()["items"][0]["spec"]
    acting = {"density": 0.05, "liner_wear": 0.1, "cohesion": pytest.approx(0.2)}
    assert record["model"] == {"name": version, "moisture_percent": 2.0, "effects": acting}
    spec = ChargeSpec.from_record(record)
    assert spec.as_record() == record
    plain = charge_test(replace(spec, model=None), tmp_path.joinpath)
    acted = charge_effects.with_effects(plain, record["model"]["effects"])
    assert charge_test(spec, tmp_path.joinpath) == acted != plain
    assert version in client.get("/charges/1").text
    assert f"--model-version {version} --moisture-percent 2" in command_of(spec)


def test_a_charge_without_a_version_is_stored_as_before(client: TestClient) -> None:
    answer = client.post("/v1/charges", json={"charge": "coke"})
    assert "model" not in answer.json()["items"][0]["spec"]


@pytest.mark.parametrize(
    ("effects", "material", "body", "sentence"),
    [
        ({"lift_speed": 0.3}, "coke", {}, "effects that a charge is simulated with: lift_speed is none"),
        ({"weigh_gain": 0.1}, "coke", {}, "weigh_gain is a fault of the measurement, so correct that"),
        ({"cohesion": 0.1}, "coke", {}, "cohesion has nothing to act on there (state its moisture_percent)"),
        ({"density": 0.1}, "pellet", {}, "a version found on coke: this one was found on pellet"),
        ({"density": 0.1}, "coke", {"scale": 15.0}, "this one holds from"),
        ({"density": 0.1}, "coke", {"model_version": "ghost"}, "the name of a model version"),
    ],
)
def test_a_version_that_does_not_fit_a_charge_is_refused_in_one_sentence(
    client: TestClient,
    database: Database,
    effects: dict[str, float],
    material: str,
    body: dict[str, Any],
    sentence: str,
) -> None:
    answer = charged(client, a_version(database, effects, material=material), **body)
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == "model_version"
    assert sentence in answer.json()["detail"]
    assert client.get("/v1/charges").json()["items"] == []


# Beyond the base.
FAR = {"feed_offcentre": {"feed_offcentre@0": 0.5}}


def a_set(database: Database, **more: str) -> int:
    """Of the piles that the versions were found on, `more` columns of conditions beside."""
    return a_data_set(database, tables(masses=MASSES["pellet"], **more))


def diagnosed(client: TestClient, data: int, version: str, **body: Any) -> Any:
    return client.post(
        "/v1/diagnoses", json={"data_set": data, "grains": 400, "model_version": version, **body}
    )


def test_a_diagnosis_begins_with_a_version(client: TestClient, database: Database) -> None:
    """Its amplitudes stand as stated, whatever the water of a condition, and a direction is kept."""
    along = {"feed_offcentre": {"feed_offcentre@0": 0.02, "feed_offcentre@90": 0.01}}
    effects = {"cohesion": 0.4, "feed_offcentre": 0.0224}
    version = a_version(database, effects, along=along)
    data = a_set(database, moisture_percent="2.0")
    answer = diagnosed(client, data, version)
    assert answer.status_code == 201, answer.text
    stored = answer.json()["spec"]
    assert stored["model"] == {
        "name": version,
        "moisture_percent": 0.0,
        "effects": {"cohesion": 0.4, **along["feed_offcentre"]},
    }
    spec = DiagnosisSpec.from_record(stored)
    assert spec.as_record() == stored
    assert spec.model is not None and dict(spec.model.effects) == stored["model"]["effects"]
    number = answer.json()["id"]
    assert version in client.get(f"/diagnoses/{number}").text
    report = client.get(f"/diagnoses/{number}/report").text
    assert "&#34;model_version&#34;: &#34;baseline+cohesion+feed_offcentre&#34;" in report
    assert f'<option value="{version}"' in client.get("/new/diagnosis").text


def test_the_same_key_and_version_are_one_diagnosis(client: TestClient, database: Database) -> None:
    version, data = a_version(database, {"density": 0.05}), a_set(database)
    body = {"data_set": data, "grains": 400, "model_version": version}
    key = {"Idempotency-Key": "monday"}
    first, again = (client.post("/v1/diagnoses", json=body, headers=key) for _ in range(2))
    assert first.status_code == 201 and first.json() == again.json()
    other = client.post("/v1/diagnoses", json={**body, "model_version": None}, headers=key)
    assert other.status_code == 422
    assert "model" not in client.post("/v1/diagnoses", json={"data_set": data}).json()["spec"]


@pytest.mark.parametrize(
    ("effects", "more", "body", "sentence"),
    [
        ({"density": 0.1}, {"withdrawn": True}, {}, "this one was withdrawn on 2023-11-14"),
        ({"density": 0.1}, {"material": "coke"}, {}, "this one was found on coke"),
        ({"density": 0.1}, {}, {"grains": 10_000}, "this one holds from"),
        ({"density": 0.1}, {}, {"contact_model": "hertz_mindlin"}, "found with paper contacts"),
        ({"weigh_gain": 0.1}, {}, {}, "weigh_gain is a fault of the measurement, so correct that"),
        ({"belt_speed": 0.1}, {}, {}, "belt_speed is none"),
        ({"cohesion": 0.3}, {}, {}, "cohesion acts on none"),
        ({"feed_offcentre": 0.02}, {}, {}, "a version that keeps the direction of feed_offcentre"),
        ({"feed_offcentre": 0.5}, {"along": FAR}, {}, "one that condition small can have"),
        ({"density": 0.1}, {}, {"model_version": "baseline+ghost"}, "the name of a model version"),
        ({"density": 0.1}, {}, {"model_version": ""}, "1 to 100 characters"),
    ],
)
def test_a_version_that_does_not_fit_a_diagnosis_is_refused_in_one_sentence(
    client: TestClient,
    database: Database,
    effects: dict[str, float],
    more: dict[str, Any],
    body: dict[str, Any],
    sentence: str,
) -> None:
    version, data = a_version(database, effects, **more), a_set(database)
    before = client.get("/v1/diagnoses").json()["items"]
    for path in ("/v1/diagnoses", "/v1/diagnoses/estimate"):
        asked_for = {"data_set": data, "grains": 400, "model_version": version, **body}
        answer = client.post(path, json=asked_for)
        assert answer.status_code == 422, answer.text
        assert answer.headers["content-type"] == "application/problem+json"
        (error,) = answer.json()["errors"]
        assert (error["field"], error["value"]) == ("model_version", asked_for["model_version"])
        assert sentence in error["allowed"]
    assert client.get("/v1/diagnoses").json()["items"] == before


def ended(database: Database, diagnosis_id: int, effects: dict[str, dict[str, Any]]) -> None:
    """Ended with these effects named."""
    with database.writing() as session:
        claim = claim_job(session, job_of_diagnosis(database, diagnosis_id), "w", 10.0)
        assert isinstance(claim, DiagnosisClaim)
        outcome = DiagnosisOutcome("named", {"verdict": "named"}, Extension("demcore-paper-400", effects))
        assert record_diagnosis(session, claim.lease, outcome)


def named(value: float) -> dict[str, Any]:
    return {"value": value, "unit": "1", "ci90": [value - 0.01, value + 0.01], "inclusion": 1.0}


def test_what_is_named_on_top_of_a_version_extends_that_version(
    client: TestClient, database: Database
) -> None:
    """The child keeps its parent, has the parent's effects as well, and a study takes it by its own name."""
    version, data = a_version(database, {"density": 0.05}), a_set(database)
    number = diagnosed(client, data, version).json()["id"]
    ended(database, number, {"density": named(0.02), "vibration": named(0.3)})
    child, parent = client.get("/v1/model-versions").json()["items"]
    assert client.get(f"/v1/diagnoses/{number}").json()["result"]["extended_model"] == child["name"]
    assert (child["name"], child["parent"]) == ("baseline+density+density+vibration", parent["id"])
    assert (parent["name"], parent["parent"]) == (version, None)
    assert {name: effect["value"] for name, effect in child["effects"].items()} == {
        "density": pytest.approx(0.07),
        "vibration": 0.3,
    }
    third = diagnosed(client, data, child["name"]).json()
    assert third["spec"]["model"]["effects"] == {"density": pytest.approx(0.07), "vibration": 0.3}
    study = asked(client, child["name"]).json()["spec"]["model"]["effects"]
    assert study == third["spec"]["model"]["effects"]


def test_a_long_line_of_versions_keeps_names_that_fit(client: TestClient, database: Database) -> None:
    version, data = a_version(database, {"vibration": 0.3}), a_set(database)
    names = {version}
    for _ in range(12):
        number = diagnosed(client, data, version).json()["id"]
        ended(database, number, {"vibration": named(0.001), "density": named(0.001)})
        version = client.get(f"/v1/diagnoses/{number}").json()["result"]["extended_model"]
        names.add(version)
    assert len(names) == 13 and max(map(len, names)) <= 100

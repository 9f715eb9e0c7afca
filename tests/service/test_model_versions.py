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
from service.domain.spec_record import spec_from_record, spec_to_record
from tests.builders.diagnoses import a_data_set, a_diagnosis, tables
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
            key: {"value": value, "unit": "1", "ci90": [0.0, 2.0 * value]} for key, value in effects.items()
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

"""The forms that start work: what they say of their fields is what the API holds to."""

from __future__ import annotations

import json
import tomllib
from importlib.resources import files
from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.dashboard.start_fields import (
    Field,
    charge_fields,
    diagnosis_fields,
    measurement_fields,
    study_fields,
)
from service.db.session import Database
from service.studies.check_charges import CheckedCharge, check_charges
from tests.builders.databases import another_writer
from tests.builders.diagnoses import a_data_set
from tests.service.dashboard.test_pages import Addresses

FORMS = ("study", "charge", "measurement", "diagnosis")


def every_field() -> list[Field]:
    groups = (*study_fields(), *charge_fields(), *measurement_fields(), *diagnosis_fields((), None))
    return [field for group in groups for field in group.fields]


@pytest.mark.parametrize("name", FORMS)
def test_every_input_has_its_label_and_its_explanation(
    name: str, client: TestClient, sqlite_database: Database
) -> None:
    text = client.get(f"/new/{name}").text
    assert Addresses(text).inline == []
    fields = [field for field in every_field() if f'data-path="{field.path}"' in text]
    assert len(fields) >= 4
    for field in fields:
        assert f'<label for="f-{field.path}">' in text and f'id="f-{field.path}"' in text
        assert f'id="f-{field.path}-help"' in text and field.help


def put(path: str, value: float) -> dict[str, Any]:
    """A body with one field."""
    names = path.split(".")
    body: Any = value
    for name in reversed(names):
        body = [body] if name.isdigit() else {name: body}
    return dict(body)


def bound(field: Field) -> bool:
    return field.low is not None and field.kind in ("number", "whole") and "window" not in field.path


@pytest.mark.parametrize(
    "field",
    [f for g in study_fields() for f in g.fields if bound(f) and "tolerance" not in f.path],
    ids=lambda f: f.path,
)
def test_the_api_refuses_what_lies_outside_a_studys_ranges_and_names_the_field(
    field: Field, client: TestClient
) -> None:
    assert field.low is not None and field.high is not None
    beyond = 1 if field.kind == "whole" else 0.01
    for value in (field.low - beyond, field.high + beyond):
        body = put(field.path, int(value) if field.kind == "whole" else round(value, 6))
        answer = client.post("/v1/studies/estimate", json={"material": "pellet", **body})
        assert answer.status_code == 422, value
        named = {error["field"] for error in answer.json()["errors"]}
        known = {field.path, *field.refused_as}
        assert any(name == own or name.startswith(own.rsplit(".", 1)[0]) for name in named for own in known)


@pytest.mark.parametrize("name", ["grains", "first_wave", "second_wave", "plants", "seed"])
def test_a_diagnosis_has_the_ranges_that_its_form_says(
    name: str, client: TestClient, sqlite_database: Database
) -> None:
    data_set = a_data_set(sqlite_database)
    field = next(f for g in diagnosis_fields((), None) for f in g.fields if f.path == name)
    assert field.low is not None and field.high is not None
    for value, status in ((field.low, 200), (field.high, 200), (field.low - 1, 422), (field.high + 1, 422)):
        body = {"data_set": data_set, name: int(value)}
        answer = client.post("/v1/diagnoses/estimate", json=body)
        assert answer.status_code == status, (value, answer.json())
        if status == 422:
            assert answer.json()["errors"][0]["field"] == name


def test_the_plants_defaults_are_the_shipped_ones() -> None:
    plant = tomllib.loads(files("demcore").joinpath("data/plant.toml").read_text(encoding="utf-8"))
    shown = [f for g in charge_fields() for f in g.fields if f.path.startswith("plant.")]
    assert len(shown) == 4
    for field in shown:
        _, part, key = field.path.split(".")
        assert float(field.default) == plant[part][key]["value"]


def test_an_estimate_stores_nothing(client: TestClient, sqlite_database: Database) -> None:
    answer = client.post("/v1/studies/estimate", json={"material": "pellet", "budget": 7})
    assert answer.status_code == 200
    assert answer.json()["runs"] == 7 and answer.json()["seconds"] is None
    assert "no pellet has run here yet" in answer.json()["text"]
    charge = client.post("/v1/charges/estimate", json={"charge": "coke", "scale": 10.0, "seeds": [1, 2]})
    assert charge.json()["runs"] == 2 and charge.json()["seconds"] > 0
    assert "2 charges, each: " in charge.json()["text"]
    for path in ("studies", "charges", "jobs"):
        assert client.get(f"/v1/{path}").json()["items"] == [], path


def test_an_estimate_waits_for_no_writer(client: TestClient, sqlite_database: Database) -> None:
    """A form asks at every pause of typing: each question took the write lock, a charge's for seconds."""
    data_set = a_data_set(sqlite_database)
    with another_writer(sqlite_database):
        for path, body in (
            ("studies", {"material": "pellet"}),
            ("charges", {"charge": "coke", "scale": 10.0}),
            ("diagnoses", {"data_set": data_set}),
        ):
            assert client.post(f"/v1/{path}/estimate", json=body).status_code == 200, path


def test_a_charge_is_checked_before_the_write_lock_is_taken(
    client: TestClient, sqlite_database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    checked = []

    def check(*arguments: Any) -> list[CheckedCharge]:
        with another_writer(sqlite_database):
            checked.append(check_charges(*arguments))
        return checked[-1]

    monkeypatch.setattr("service.api.charges.check_charges", check)
    answer = client.post("/v1/charges", json={"charge": "coke", "scale": 10.0})
    assert answer.status_code == 201
    assert answer.json()["items"][0]["cost"]["text"] == checked[0][0].cost["text"]


def test_a_study_costs_what_its_like_took_here(client: TestClient) -> None:
    """A stored study of coke at scale 3.2: twice as fine is sixteen times as long."""
    path = files("tests").joinpath("../docs/studies/coke/study.json")
    assert client.post("/v1/studies/import", json=json.loads(path.read_text())).status_code == 201
    seconds = [
        client.post(
            "/v1/studies/estimate", json={"material": "coke", "scale": scale, "budget": budget}
        ).json()
        for scale, budget in ((3.2, 10), (3.2, 20), (1.6, 10))
    ]
    runs = [
        run["wall_s"]
        for design in json.loads(path.read_text())["study"]["designs"]
        for run in design["runs"]
        if run["exit_class"] == "done"
    ]
    assert 10 * min(runs) <= seconds[0]["seconds"] <= 10 * max(runs)
    assert seconds[1]["seconds"] == pytest.approx(2 * seconds[0]["seconds"])
    assert seconds[2]["seconds"] == pytest.approx(16 * seconds[0]["seconds"])
    assert "as coke at scale 3.2 ran here" in seconds[0]["text"]


def test_a_diagnosis_begins_with_the_set_that_was_just_uploaded(
    client: TestClient, sqlite_database: Database
) -> None:
    first = a_data_set(sqlite_database)
    assert f'<option value="{first}" selected>' in client.get(f"/new/diagnosis?data_set={first}").text
    assert client.get("/new/diagnosis?data_set=x").status_code == 422


def test_without_measured_data_a_diagnosis_says_what_comes_first(
    client: TestClient, sqlite_database: Database
) -> None:
    assert 'href="/new/measurement">upload it first' in client.get("/new/diagnosis").text
    a_data_set(sqlite_database)
    assert "upload it first" not in client.get("/new/diagnosis").text

"""Who may do what: every route with no key, a key of each scope, and a key of another project."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

from service.app import create_app
from service.client.keys import keys_command
from service.db.access_reads import find_key
from service.db.session import Database
from service.domain.access import Scope, new_key, parse_key
from service.first_key import first_key_lines
from service.settings import Settings, get_settings
from service.studies.log_in import COOKIE
from service.studies.manage_keys import create_key, revoke_key
from tests.builders.everything import one_of_everything, paths_of

OPEN = {"/v1/health/live", "/v1/health/ready", "/login", "/static/{folder}/{name}"}
# Something that the route can read, so that it gets as far as looking for the row.
BODIES: dict[str, Any] = {
    "/v1/studies/{study_id}/budget": {"budget": 60},
    "/v1/studies/{study_id}/designs": {"x": {"rolling_resistance": 0.2}},
    "/v1/designs/{design_id}/rerun": {"same_seed": False},
    "/v1/diagnoses/{diagnosis_id}/claims/{claimed}": {"state": "confirmed"},
}
NOT_ROWS = ("{name}", "{folder}", "{key_id}", "{effect_id}")


@pytest.fixture
def settings(tmp_path: Path, sqlite_database: Database) -> Settings:
    return Settings(data_dir=tmp_path, database_url=sqlite_database.url, auth="on")


@pytest.fixture
def client(settings: Settings) -> Iterator[TestClient]:
    with TestClient(create_app(settings), raise_server_exceptions=False, follow_redirects=False) as found:
        yield found


def a_key(database: Database, scope: Scope, project: str = "default") -> str:
    with database.writing() as session:
        return create_key(session, f"{scope.value} of {project}", scope, project)[1].text


def bearer(key: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {key}"}


def routes(client: TestClient) -> list[tuple[str, str]]:
    """Of the application itself, so that no page or resource can be forgotten here."""
    assert isinstance(client.app, FastAPI)
    return [
        (method, path)
        for path, methods in paths_of(client.app).items()
        for method in sorted(methods - {"HEAD"})
    ]


@pytest.fixture
def rows(sqlite_database: Database, settings: Settings) -> dict[str, str]:
    return one_of_everything(sqlite_database, settings)


def ask(client: TestClient, method: str, path: str, rows: dict[str, str], key: str | None) -> int:
    address = re.sub(r"\{(\w+)\}", lambda found: rows[found[1]], path)
    headers = {} if key is None else bearer(key)
    with client.stream(method, address, headers=headers, json=BODIES.get(path)) as answer:
        status = answer.status_code
        if status >= 400 and path.startswith("/v1"):
            assert answer.headers["content-type"] == "application/problem+json", (method, path)
    return int(status)


def expected(method: str, path: str) -> dict[str, str]:
    """What each may: yes, or the status that refuses."""
    is_page = (
        not path.startswith(("/v1", "/metrics", "/openapi"))
        and method == "GET"
        and not path.endswith("/parts")
        and "/scene" not in path
    )
    if path in OPEN:
        return dict.fromkeys(("no key", "read", "run", "admin"), "yes")
    nobody = "303" if is_page else "401"
    if path.startswith("/v1/keys"):
        return {"no key": nobody, "read": "403", "run": "403", "admin": "yes"}
    reads = "yes" if method == "GET" or path == "/logout" else "403"
    return {"no key": nobody, "read": reads, "run": "yes", "admin": "yes"}


def test_every_route_with_every_kind_of_key(
    client: TestClient, sqlite_database: Database, rows: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    keys: dict[str, str | None] = {
        "no key": None,
        **{scope.value: a_key(sqlite_database, scope) for scope in Scope},
    }
    stranger = a_key(sqlite_database, Scope.RUN, "elsewhere")
    spare = parse_key(a_key(sqlite_database, Scope.READ))
    assert spare is not None
    with sqlite_database.reading() as session:
        found = find_key(session, spare.prefix)
        assert found is not None
        rows["key_id"] = str(found.id)  # what is revoked on the way
    lines, wrong = list[str](), list[str]()
    for method, path in routes(client):
        wanted = expected(method, path)
        has_row = "{" in path and not any(name in path for name in NOT_ROWS)
        # The stranger first: what the others may change is then still there.
        other = ask(client, method, path, rows, stranger) if has_row else None
        got = {}
        for who, key in keys.items():
            if path in ("/v1/studies/{study_id}/events",) and wanted[who] == "yes":
                got[who] = "yes"  # an open stream; what refuses it was tried above
                continue
            status = ask(client, method, path, rows, key)
            # The login form refuses by itself: nothing was typed.
            refused = path != "/login" and (status in (401, 403) or (status == 303 and path != "/logout"))
            got[who] = str(status) if refused else "yes"
            if has_row and not refused and status == 404:
                wrong.append(f"{method} {path}: {who} does not find its own row")
        told = {**got, "another project's id": "-" if other is None else str(other)}
        lines.append(f"{method:5} {path:46} " + "  ".join(f"{who}: {answer}" for who, answer in told.items()))
        if got != wanted or other not in (None, 404):
            wrong.append(f"{lines[-1]}; expected {wanted}")
    with capsys.disabled():
        print("\n" + "\n".join(lines))
    assert not wrong, "\n".join(wrong)
    assert len(lines) > 65


def test_lists_show_one_project_and_its_own_work_is_separate(
    client: TestClient, sqlite_database: Database, rows: dict[str, str]
) -> None:
    home, away = (a_key(sqlite_database, Scope.RUN, project) for project in ("default", "elsewhere"))
    lists = ("studies", "jobs", "charges", "measurements", "diagnoses", "model-versions")
    for name in lists:
        assert client.get(f"/v1/{name}", headers=bearer(home)).json()["items"], name
        assert client.get(f"/v1/{name}", headers=bearer(away)).json()["items"] == [], name
    headers = {**bearer(away), "Idempotency-Key": "one"}
    first = client.post("/v1/studies", json={"material": "pellet"}, headers=headers)
    assert first.status_code == 201, first.text
    same_key_at_home = client.post(
        "/v1/studies", json={"material": "coke"}, headers={**bearer(home), "Idempotency-Key": "one"}
    )
    assert same_key_at_home.status_code == 201
    assert same_key_at_home.json()["id"] != first.json()["id"]
    ids = [item["id"] for item in client.get("/v1/studies", headers=bearer(away)).json()["items"]]
    assert ids == [first.json()["id"]]
    assert len(client.get("/v1/jobs", headers=bearer(away)).json()["items"]) == 1
    assert f'/studies/{rows["study_id"]}"' not in client.get("/", headers=bearer(away)).text


def test_a_body_cannot_name_another_projects_rows(
    client: TestClient, sqlite_database: Database, rows: dict[str, str]
) -> None:
    headers = bearer(a_key(sqlite_database, Scope.RUN, "elsewhere"))
    for path, body in (
        ("/v1/studies", {"material": "pellet", "warm_start": [int(rows["study_id"])]}),
        ("/v1/diagnoses", {"data_set": int(rows["data_set_id"])}),
        (
            "/v1/charges",
            {"charge": "coke", "plant": {"deflector": {"geometry": int(rows["geometry_id"]), "units": "mm"}}},
        ),
        ("/v1/charges", {"charge": "coke", "parameters": {"coke": {"study": int(rows["study_id"])}}}),
    ):
        answer = client.post(path, json=body, headers=headers)
        assert answer.status_code in (404, 422), (path, answer.text)


@pytest.mark.parametrize(
    "header",
    [
        {},
        {"Authorization": "Bearer"},
        {"Authorization": "Basic dXNlcjpwYXNz"},
        {"Authorization": f"Bearer {new_key().text}"},
        {"Authorization": "Bearer talus_00000000_" + "é" * 43},
        {"Cookie": f"{COOKIE}=00000000.99999999999.{'0' * 64}"},
        {"Cookie": f"{COOKIE}=a.b.c.d"},
        {"Cookie": "; =;=;"},
    ],
)
def test_what_is_no_key_is_refused(client: TestClient, header: dict[str, str]) -> None:
    raw = {name: value.encode() for name, value in header.items()}
    answer = client.get("/v1/studies", headers=raw)
    assert answer.status_code == 401
    assert answer.headers["www-authenticate"] == "Bearer"
    assert answer.json()["status"] == 401


def test_a_revoked_key_ends_at_once_and_so_do_its_sessions(
    client: TestClient, sqlite_database: Database
) -> None:
    key = a_key(sqlite_database, Scope.READ)
    client.post("/login", data={"key": key})
    assert client.get("/v1/studies").status_code == 200, "the cookie stands for the key"
    with sqlite_database.writing() as session:
        revoke_key(session, 1)
    assert client.get("/v1/studies").status_code == 401
    assert client.get("/v1/studies", headers=bearer(key)).status_code == 401


def test_a_key_is_stored_as_its_hash_only(sqlite_database: Database, settings: Settings) -> None:
    key = a_key(sqlite_database, Scope.ADMIN)
    parsed = parse_key(key)
    assert parsed is not None
    stored = b"".join(file.read_bytes() for file in settings.data_dir.glob("talus.db*"))
    assert parsed.prefix.encode() in stored
    assert parsed.secret.encode() not in stored


def test_the_login_form_opens_a_session_and_leads_nowhere_else(
    client: TestClient, sqlite_database: Database
) -> None:
    there = client.get("/studies/1")
    assert (there.status_code, there.headers["location"]) == (303, "/login?next=/studies/1")
    assert client.post("/login", data={"key": "wrong"}).status_code == 401
    key = a_key(sqlite_database, Scope.READ)
    opened = client.post("/login", data={"key": key, "next": "/studies/1"})
    assert (opened.status_code, opened.headers["location"]) == (303, "/studies/1")
    cookie = opened.headers["set-cookie"]
    for part in ("HttpOnly", "SameSite=strict", "Path=/"):
        assert part in cookie
    assert key not in cookie
    for trick in ("//evil.example", "/\\evil.example", "https://evil.example", "/a\r\nSet-Cookie: x=y"):
        assert client.post("/login", data={"key": key, "next": trick}).headers["location"] == "/"


def test_a_session_is_secure_over_https(settings: Settings, sqlite_database: Database) -> None:
    key = a_key(sqlite_database, Scope.READ)
    with TestClient(create_app(settings), base_url="https://talus.example", follow_redirects=False) as client:
        assert "Secure" in client.post("/login", data={"key": key}).headers["set-cookie"]


@pytest.mark.parametrize("header", [{"Sec-Fetch-Site": "cross-site"}, {"Origin": "https://evil.example"}])
def test_another_sites_page_changes_nothing_whether_keys_are_asked_for_or_not(
    settings: Settings, sqlite_database: Database, header: dict[str, str]
) -> None:
    app = create_app(settings.model_copy(update={"auth": "off"}))
    with TestClient(app) as client:
        refused = client.post("/v1/studies", json={"material": "pellet"}, headers=header)
        assert refused.status_code == 403
        own = {"Sec-Fetch-Site": "same-origin", "Origin": "http://testserver"}
        assert client.post("/v1/studies", json={"material": "pellet"}, headers=own).status_code == 201


def test_keys_are_made_and_revoked_over_the_api(client: TestClient, sqlite_database: Database) -> None:
    admin = bearer(a_key(sqlite_database, Scope.ADMIN))
    made = client.post("/v1/keys", json={"name": "grafana", "scope": "read"}, headers=admin).json()
    assert client.get("/v1/studies", headers=bearer(made["key"])).status_code == 200
    assert [key["name"] for key in client.get("/v1/keys", headers=admin).json()["items"]] == [
        "grafana",
        "admin of default",
    ]
    assert "key" not in client.get("/v1/keys", headers=admin).json()["items"][0]
    number = made["about"]["id"]
    assert client.post(f"/v1/keys/{number}/revoke", headers=admin).json()["revoked_at"]
    assert client.get("/v1/studies", headers=bearer(made["key"])).status_code == 401
    assert client.post("/v1/keys", json={"name": "x", "project": "No!"}, headers=admin).status_code == 422


def test_the_first_key_is_made_once_where_keys_are_asked_for(
    settings: Settings, sqlite_database: Database
) -> None:
    assert first_key_lines(settings.model_copy(update={"auth": "off"})) == []
    first = first_key_lines(settings)
    key = parse_key(first[0].rpartition(" ")[2])
    assert key is not None
    assert first_key_lines(settings) == []


@pytest.mark.parametrize(
    ("auth", "host", "asks"),
    [
        ("auto", "127.0.0.1", False),
        ("auto", "::1", False),
        ("auto", "0.0.0.0", True),
        ("auto", "10.0.0.5", True),
        ("on", "127.0.0.1", True),
        ("off", "0.0.0.0", False),
    ],
)
def test_keys_are_asked_for_unless_only_this_machine_can_ask(
    auth: Any, host: str, asks: bool, tmp_path: Path
) -> None:
    assert Settings(data_dir=tmp_path, auth=auth, host=host).asks_for_keys is asks


def test_keys_from_the_command_line(
    settings: Settings, sqlite_database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    from click.testing import CliRunner

    monkeypatch.setenv("TALUS_DATABASE_URL", sqlite_database.url)
    get_settings.cache_clear()
    try:
        run = CliRunner().invoke
        key = parse_key(run(keys_command, ["create", "lab", "--scope", "read"]).output.strip())
        assert key is not None
        assert key.prefix in run(keys_command, ["list"]).output
        assert run(keys_command, ["revoke", key.prefix]).exit_code == 0
        assert run(keys_command, ["revoke", key.prefix]).exit_code == 2
        assert run(keys_command, ["create", "lab", "--project", "UP"]).exit_code == 2
    finally:
        get_settings.cache_clear()

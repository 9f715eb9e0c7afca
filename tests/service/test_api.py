"""The API as a client sees it."""

from __future__ import annotations

import hashlib
import threading
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.app import create_app, document_text
from service.db.presence import report_presence
from service.db.session import Database
from service.domain.outcome import StoredArtifact
from service.domain.states import JobKind
from service.settings import Settings
from service.studies.record_measurement import record_measurement
from tests.builders.studies import (
    a_measurement,
    a_simulate_job,
    a_study,
    add_finished_designs,
    claimed,
    job,
    open_jobs,
    propose_next,
)

ROOT = Path(__file__).resolve().parents[2]


def post(client: TestClient, body: dict[str, Any], key: str | None = None) -> Any:
    return client.post("/v1/studies", json=body, headers={"Idempotency-Key": key} if key else {})


def test_a_materials_name_is_enough(client: TestClient) -> None:
    response = post(client, {"material": "pellet"})
    assert response.status_code == 201
    assert response.headers["location"] == f"/v1/studies/{response.json()['id']}"
    study = client.get(response.headers["location"]).json()
    assert study == response.json()
    assert study["state"] == "running"
    assert study["counters"] == {"feasible": 0, "unfeasible": 0, "error": 0}
    assert study["stop"] is None
    assert study["spec"]["responses"] == [
        {
            "observable": "angle_deg",
            "target": 25.5,
            "window": [25.0, 26.0],
            "tolerance": 0.5,
            "uncertainty": 0.0,
        }
    ]
    assert list(study["spec"]["variables"]) == [
        "particle_particle_static_friction",
        "particle_wall_static_friction",
        "particle_particle_restitution",
        "rolling_resistance",
    ]


@pytest.mark.parametrize(
    ("material", "target", "window"),
    [
        ("coke", 36.5, [35.0, 38.0]),
        ("sinter", 31.0, [29.0, 33.0]),
        ("pellet", 25.5, [25.0, 26.0]),
        ("sinter65_pellet35", 29.075, [27.6, 30.55]),
    ],
)
def test_the_papers_targets_are_the_defaults(
    client: TestClient, material: str, target: float, window: list[float]
) -> None:
    (angle,) = post(client, {"material": material}).json()["spec"]["responses"]
    assert (angle["target"], angle["window"]) == (target, window)


def test_the_default_window_moves_with_the_target(client: TestClient) -> None:
    spec = post(client, {"material": "coke", "objective": {"target_deg": 30.1}}).json()["spec"]
    assert spec["responses"][0]["window"] == [28.6, 31.6]


def test_what_is_not_searched_has_a_stored_value(client: TestClient) -> None:
    body = {
        "material": "pellet",
        "variables": {"rolling_resistance": {"upper": 0.3}},
        "fixed": {"particle_wall_static_friction": 0.4},
    }
    spec = post(client, body).json()["spec"]
    assert spec["variables"] == {"rolling_resistance": {"lower": 0.05, "upper": 0.3, "step": 0.01}}
    assert spec["fixed"] == {
        "particle_particle_static_friction": 0.5,
        "particle_particle_restitution": 0.35,
        "particle_wall_static_friction": 0.4,
    }


def test_a_fixed_parameter_is_not_searched_by_default(client: TestClient) -> None:
    spec = post(client, {"material": "pellet", "fixed": {"rolling_resistance": 0.2}}).json()["spec"]
    assert "rolling_resistance" not in spec["variables"]
    assert len(spec["variables"]) == 3


def test_50_parallel_posts_with_one_key_make_one_study(client: TestClient) -> None:
    answers = list[Any]()

    def send() -> None:
        answers.append(post(client, {"material": "coke"}, key="order-66"))

    threads = [threading.Thread(target=send) for _ in range(50)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {answer.status_code for answer in answers} == {201}
    assert len({answer.content for answer in answers}) == 1
    assert len({answer.headers["location"] for answer in answers}) == 1
    assert len(client.get("/v1/studies").json()["items"]) == 1
    assert len(client.get("/v1/jobs").json()["items"]) == 1


def test_a_key_is_not_for_another_body(client: TestClient) -> None:
    assert post(client, {"material": "coke"}, key="k").status_code == 201
    refused = post(client, {"material": "coke", "seed": 2}, key="k")
    assert refused.status_code == 422
    assert refused.json()["errors"][0]["field"] == "Idempotency-Key"
    assert len(client.get("/v1/studies").json()["items"]) == 1


def pages(client: TestClient, path: str, limit: int) -> list[list[Any]]:
    found, cursor = [], None
    while True:
        page = client.get(path, params={"limit": limit, **({"cursor": cursor} if cursor else {})}).json()
        found.append(page["items"])
        cursor = page["next_cursor"]
        if cursor is None:
            return found


def test_lists_go_page_by_page_without_gaps(client: TestClient, sqlite_database: Database) -> None:
    ids = [a_study(sqlite_database) for _ in range(7)]
    found = pages(client, "/v1/studies", 3)
    assert [len(page) for page in found] == [3, 3, 1]
    assert [item["id"] for page in found for item in page] == ids[::-1]
    jobs = pages(client, "/v1/jobs", 2)
    assert [len(page) for page in jobs] == [2, 2, 2, 1]
    assert sorted(item["study_id"] for page in jobs for item in page) == ids
    add_finished_designs(sqlite_database, ids[0], 5)
    designs = pages(client, f"/v1/studies/{ids[0]}/designs", 2)
    assert [item["number"] for page in designs for item in page] == [1, 2, 3, 4, 5]


def test_a_list_does_not_shift_when_rows_are_added(client: TestClient, sqlite_database: Database) -> None:
    ids = [a_study(sqlite_database) for _ in range(4)]
    first = client.get("/v1/studies?limit=2").json()
    a_study(sqlite_database)
    second = client.get(f"/v1/studies?limit=2&cursor={first['next_cursor']}").json()
    assert [item["id"] for item in second["items"]] == [ids[1], ids[0]]
    assert second["next_cursor"] is None


def test_jobs_can_be_filtered(client: TestClient, sqlite_database: Database) -> None:
    study_id, job_id = a_simulate_job(sqlite_database, parallel=1)
    a_study(sqlite_database)
    found = client.get("/v1/jobs", params={"state": "queued", "study_id": study_id}).json()["items"]
    assert [(item["id"], item["kind"]) for item in found] == [(job_id, "simulate")]


def finished_design(database: Database, settings: Settings, content: bytes = b"\x89PNG pile") -> int:
    study_id, job_id = a_simulate_job(database, parallel=1)
    sha256 = hashlib.sha256(content).hexdigest()
    path = settings.artifacts_dir / sha256[:2] / sha256
    path.parent.mkdir(parents=True)
    path.write_bytes(content)
    picture = StoredArtifact(
        "picture", "pile.png", "image/png", sha256, len(content), f"{sha256[:2]}/{sha256}"
    )
    with database.writing() as session:
        record_measurement(session, claimed(database, job_id).lease, a_measurement(25.4, (picture,)))
    return study_id


def test_a_design_with_its_file(client: TestClient, sqlite_database: Database, settings: Settings) -> None:
    study_id = finished_design(sqlite_database, settings)
    (design,) = client.get(f"/v1/studies/{study_id}/designs").json()["items"]
    assert design == client.get(f"/v1/designs/{design['id']}").json()
    assert (design["state"], design["verdict"], design["angle_deg"]) == ("COMPLETE", "feasible", 25.4)
    assert design["results"] == {"mass_on_base_kg": 12.5}
    (artifact,) = client.get(f"/v1/designs/{design['id']}/artifacts").json()["items"]
    assert artifact == design["artifacts"][0]
    file = client.get(artifact["url"])
    assert file.content == b"\x89PNG pile"
    assert file.headers["content-type"] == "image/png"
    assert hashlib.sha256(file.content).hexdigest() == artifact["sha256"]


def test_a_file_that_is_gone_is_not_found(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    study_id = finished_design(sqlite_database, settings)
    (design,) = client.get(f"/v1/studies/{study_id}/designs").json()["items"]
    for file in settings.artifacts_dir.rglob("*/*"):
        file.unlink()
    assert client.get(design["artifacts"][0]["url"]).status_code == 404


def test_a_job_shows_its_attempts(client: TestClient, sqlite_database: Database) -> None:
    _, job_id = a_simulate_job(sqlite_database)
    claimed(sqlite_database, job_id, "worker-a")
    answer = client.get(f"/v1/jobs/{job_id}").json()
    assert (answer["state"], answer["attempt"]) == ("running", 1)
    assert [(run["attempt"], run["worker_id"], run["exit_class"]) for run in answer["runs"]] == [
        (1, "worker-a", None)
    ]


def test_cancel_a_job(client: TestClient, sqlite_database: Database) -> None:
    study_id, job_id = a_simulate_job(sqlite_database)
    response = client.post(f"/v1/jobs/{job_id}/cancel")
    assert (response.status_code, response.json()["state"]) == (202, "cancelled")
    (propose_id,) = open_jobs(sqlite_database, study_id, JobKind.PROPOSE)
    refused = client.post(f"/v1/jobs/{propose_id}/cancel")
    assert refused.status_code == 409
    assert f"cancel study {study_id}" in refused.json()["detail"]


def test_cancel_a_study(client: TestClient, sqlite_database: Database) -> None:
    study_id = a_study(sqlite_database)
    response = client.post(f"/v1/studies/{study_id}/cancel")
    assert (response.status_code, response.json()["state"]) == (202, "cancelled")
    assert response.json()["stop"]["reason"] == "user"
    assert client.post(f"/v1/studies/{study_id}/cancel").status_code == 202
    assert open_jobs(sqlite_database, study_id) == []


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("GET", "/v1/studies/99"),
        ("GET", "/v1/studies/99/designs"),
        ("GET", "/v1/studies/99/events"),
        ("POST", "/v1/studies/99/cancel"),
        ("GET", "/v1/designs/99"),
        ("GET", "/v1/designs/99/artifacts"),
        ("GET", "/v1/artifacts/99"),
        ("GET", "/v1/jobs/00000000-0000-4000-8000-000000000000"),
        ("POST", "/v1/jobs/00000000-0000-4000-8000-000000000000/cancel"),
        ("GET", "/v1/materials/sand"),
        ("GET", "/v1/nothing"),
    ],
)
def test_what_is_not_there(client: TestClient, method: str, path: str) -> None:
    response = client.request(method, path)
    assert response.status_code == 404
    assert response.headers["content-type"] == "application/problem+json"
    assert response.json()["status"] == 404


@pytest.mark.parametrize(
    ("method", "path", "allowed"),
    [
        ("DELETE", "/v1/studies", "GET, POST"),
        ("OPTIONS", "/v1/charges", "GET, POST"),
        ("POST", "/v1/studies/1", "GET"),
        # Not the charge, the study or the diagnosis with such an id.
        ("GET", "/v1/charges/comparison", "POST"),
        ("GET", "/v1/studies/import", "POST"),
        ("PUT", "/v1/diagnoses/estimate", "POST"),
    ],
)
def test_a_method_that_is_not_offered(client: TestClient, method: str, path: str, allowed: str) -> None:
    """RFC 9110, section 15.5.6: the answer lists every method that the address takes."""
    response = client.request(method, path)
    assert (response.status_code, response.headers["allow"]) == (405, allowed)
    assert response.headers["content-type"] == "application/problem+json"
    assert response.json()["detail"] == f"{method} is not taken here, allowed is {allowed}."


def test_materials_and_rigs(client: TestClient) -> None:
    materials = client.get("/v1/materials").json()["items"]
    names = ["coke", "sinter", "pellet", "sinter65_pellet35"]
    assert [material["name"] for material in materials] == names
    assert [rig["name"] for rig in client.get("/v1/rigs").json()["items"]] == names
    pellet = client.get("/v1/materials/pellet").json()
    assert pellet == materials[2]
    assert pellet["bulk_density_kg_m3"] == 2088.0
    assert pellet["sizes"] == [{"lower_m": 0.01, "upper_m": 0.022, "mass_share": 1.0}]
    rigs = {rig["name"]: rig for rig in client.get("/v1/rigs").json()["items"]}
    assert rigs["pellet"]["base_diameter_m"] == 0.6


def test_live_and_ready(client: TestClient, sqlite_database: Database) -> None:
    assert client.get("/v1/health/live").json() == {"status": "alive"}
    answer = client.get("/v1/health/ready")
    assert (answer.status_code, answer.json()["ready"]) == (200, True)
    checks = answer.json()["checks"]
    assert checks["database"]["ok"]
    assert checks["schema"]["ok"]
    assert "no worker was seen" in checks["workers"]["reason"]
    with sqlite_database.writing() as session:
        report_presence(session, "w", "worker", "here", 1)
        report_presence(session, "d", "dispatcher", "here", 2, problem="ConnectionError: refused")
    checks = client.get("/v1/health/ready").json()["checks"]
    assert checks["workers"]["ok"]
    assert checks["dispatcher"]["ok"]
    assert checks["broker"] == {"ok": False, "required": False, "reason": "ConnectionError: refused"}


def test_an_old_schema_is_not_ready(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, database_url=f"sqlite:///{tmp_path / 'empty.db'}")
    with TestClient(create_app(settings)) as client:
        answer = client.get("/v1/health/ready")
    assert answer.status_code == 503
    assert "schema none" in answer.json()["checks"]["schema"]["reason"]


@pytest.mark.parametrize("backend", ["sqlite", "postgresql"])
def test_a_database_that_is_away(tmp_path: Path, backend: str) -> None:
    url = "postgresql+psycopg://talus@127.0.0.1:1/talus"
    if backend == "sqlite":
        url = f"sqlite:///{tmp_path / 'gone' / 'talus.db'}"
    app = create_app(Settings(data_dir=tmp_path, database_url=url))
    if backend == "sqlite":
        (tmp_path / "gone").rmdir()
    with TestClient(app, raise_server_exceptions=False) as client:
        for response in (
            client.post("/v1/studies", json={"material": "pellet"}),
            client.get("/v1/studies/1"),
        ):
            assert response.status_code == 503
            assert response.headers["retry-after"] == "5"
            assert response.headers["content-type"] == "application/problem+json"
        assert client.get("/v1/health/live").status_code == 200
        ready = client.get("/v1/health/ready")
        assert ready.status_code == 503
        assert "does not answer" in ready.json()["checks"]["database"]["reason"]


def test_the_api_needs_no_broker(client: TestClient, sqlite_database: Database) -> None:
    """The settings name a broker that does not exist; only the job's row is made."""
    study_id = post(client, {"material": "pellet"}).json()["id"]
    (job_id,) = open_jobs(sqlite_database, study_id)
    assert job(sqlite_database, job_id).published_at is None


def test_the_committed_openapi_document_is_current(settings: Settings) -> None:
    committed = (ROOT / "docs" / "openapi.json").read_text(encoding="utf-8")
    assert committed == document_text(create_app(settings)), "run: python -m service.app > docs/openapi.json"


def test_every_operation_has_an_id_a_summary_and_problem_answers(settings: Settings) -> None:
    document = create_app(settings).openapi()
    operations = [
        (path, operation) for path, methods in document["paths"].items() for operation in methods.values()
    ]
    ids = [operation["operationId"] for _, operation in operations]
    assert len(set(ids)) == len(ids)
    for path, operation in operations:
        assert operation["summary"]
        assert operation["description"]
        for status, answer in operation["responses"].items():
            if int(status) >= 400 and "/health/" not in path:
                assert list(answer["content"]) == ["application/problem+json"], (path, status)
    assert "HTTPValidationError" not in document["components"]["schemas"]


def test_a_propose_job_appears_with_the_study(client: TestClient, sqlite_database: Database) -> None:
    study_id = post(client, {"material": "pellet"}).json()["id"]
    claim = propose_next(sqlite_database, study_id)
    assert claim.spec.primary.target == 25.5
    assert len(client.get(f"/v1/studies/{study_id}/designs").json()["items"]) == 1

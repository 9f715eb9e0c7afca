"""What a study may be asked for over REST: responses, strategy, table, coarse runs, a warm start; its controls."""

from __future__ import annotations

from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.db.session import Database
from service.domain.history import StudyStop
from service.domain.states import JobKind
from service.studies.cancel_study import cancel_study
from service.studies.record_recommendation import record_recommendation
from tests.builders.studies import (
    a_finished_study,
    a_proposal,
    a_study,
    claimed,
    designs,
    open_jobs,
    propose_next,
    simulate,
    study,
)

PP, ROLLING = "particle_particle_static_friction", "rolling_resistance"
FIXED = {"particle_wall_static_friction": 0.4, "particle_particle_restitution": 0.3}


def created(client: TestClient, **body: Any) -> dict[str, Any]:
    response = client.post("/v1/studies", json={"material": "pellet", **body})
    assert response.status_code == 201, response.text
    spec: dict[str, Any] = response.json()["spec"]
    return spec


def test_several_responses_with_their_defaults(client: TestClient) -> None:
    asked = [
        {"observable": "angle_deg", "uncertainty": 0.4},
        {"observable": "mass_on_base_kg", "target": 12.0},
        {"observable": "heap_height_m", "target": 0.1, "window": [0.08, 0.12], "tolerance": 0.01},
    ]
    assert created(client, responses=asked)["responses"] == [
        {
            "observable": "angle_deg",
            "target": 25.5,
            "window": [25.0, 26.0],
            "tolerance": 0.5,
            "uncertainty": 0.4,
        },
        {
            "observable": "mass_on_base_kg",
            "target": 12.0,
            "window": [10.8, 13.2],
            "tolerance": 0.6,
            "uncertainty": 0.0,
        },
        {
            "observable": "heap_height_m",
            "target": 0.1,
            "window": [0.08, 0.12],
            "tolerance": 0.01,
            "uncertainty": 0.0,
        },
    ]


def test_any_parameter_can_be_searched_fixed_or_derived(client: TestClient) -> None:
    spec = created(
        client,
        variables={ROLLING: {}, "youngs_modulus_pa": {}},
        fixed={"particle_wall_restitution": 0.4},
        derived={PP: "2 * rolling_resistance"},
    )
    assert spec["variables"]["youngs_modulus_pa"] == {"lower": 1e6, "upper": 1e8, "step": None}
    assert spec["derived"] == {PP: "2 * rolling_resistance"}
    assert spec["fixed"]["particle_wall_restitution"] == 0.4
    assert PP not in spec["fixed"]


def test_a_derived_parameter_is_not_searched_by_default(client: TestClient) -> None:
    spec = created(client, derived={"particle_wall_static_friction": f"0.8 * {PP}"})
    assert list(spec["variables"]) == [PP, "particle_particle_restitution", ROLLING]


@pytest.mark.parametrize(
    "table",
    [
        {
            "table": [
                {"x": {PP: 0.5, ROLLING: 0.2}},
                {"x": {PP: 0.6, ROLLING: 0.3}, "results": {"angle_deg": 27.5}},
            ]
        },
        {"table_csv": f"\ufeff{PP}, {ROLLING},angle_deg\r\n0.5,0.2,\r\n\r\n0.6,0.3,27.5\r\n"},
    ],
    ids=["rows", "csv"],
)
def test_a_table_with_a_known_result_is_run_but_for_it(
    client: TestClient, sqlite_database: Database, table: dict[str, Any]
) -> None:
    spec = created(client, strategy="table", fixed=FIXED, budget=1, initial_designs=2, **table)
    assert spec["table"] == [
        {"x": {PP: 0.5, ROLLING: 0.2}, "results": None},
        {"x": {PP: 0.6, ROLLING: 0.3}, "results": {"angle_deg": 27.5}},
    ]
    (known,) = designs(sqlite_database, 1)
    assert (known.number, known.origin, known.angle_deg) == (1, "import", 27.5)
    (job_id,) = open_jobs(sqlite_database, 1)
    history = claimed(sqlite_database, job_id).history
    assert history is not None
    assert (history.number, [d.results for d in history.finished]) == (2, [{"angle_deg": 27.5}])
    answer = client.get("/v1/studies/1").json()
    assert answer["counters"] == {"feasible": 0, "unfeasible": 0, "error": 0}, "nothing was simulated"


def test_coarse_runs_first(client: TestClient) -> None:
    assert created(client, scale=2.0, coarse={"scale": 4.0, "runs": 8})["coarse"] == {"scale": 4.0, "runs": 8}


def test_a_warm_start_brings_the_designs_of_the_same_test(database: Database) -> None:
    """The error and the two angles of the finished study; the cancelled design gave nothing."""
    source = a_finished_study(database)
    study_id = a_study(database, warm_start=(source,))
    claim = propose_next(database, study_id)
    assert claim.history is not None
    (warm,) = claim.history.warm
    told = [(d.number, d.origin, d.results and d.results["angle_deg"]) for d in warm.finished]
    assert told == [(1, "warm", 25.4), (2, "warm", 30.0), (3, "warm", None)]
    assert claim.history.finished == ()


def test_the_replicates_of_a_warm_start_tell_the_noise(database: Database) -> None:
    source = a_study(database, parallel=1)
    for seed, angle in ((1, 25.0), (2, 26.0), (3, 27.0)):
        propose_next(database, source, a_proposal(1, seed=seed))
        simulate(database, open_jobs(database, source, JobKind.SIMULATE)[0], angle)
    with database.writing() as session:
        cancel_study(session, source)
    lease = claimed(database, open_jobs(database, source)[0]).lease
    with database.writing() as session:
        assert record_recommendation(session, lease, None)
    assert study(database, source).state.value == "cancelled"
    claim = propose_next(database, a_study(database, warm_start=(source,)), StudyStop("user", "", {}))
    assert claim.history is not None
    # Sample variance of 25, 26, 27 is 1 with two degrees of freedom.
    assert (claim.history.noise["angle_deg"].sd, claim.history.noise["angle_deg"].freedom) == (1.0, 2)


@pytest.mark.parametrize(("seeds", "is_refused"), [(3, False), (5, True)])
def test_a_tolerance_under_half_the_measured_noise_is_refused(
    client: TestClient, sqlite_database: Database, seeds: int, is_refused: bool
) -> None:
    """Angles 3 deg apart scatter by more than twice the tolerance; five seeds are needed to be sure of it."""
    source = a_study(sqlite_database, parallel=1, budget=seeds)
    for seed in range(1, seeds + 1):
        propose_next(sqlite_database, source, a_proposal(1, seed=seed))
        simulate(sqlite_database, open_jobs(sqlite_database, source, JobKind.SIMULATE)[0], 20.0 + 3.0 * seed)
    with sqlite_database.writing() as session:
        cancel_study(session, source)
    lease = claimed(sqlite_database, open_jobs(sqlite_database, source)[0]).lease
    with sqlite_database.writing() as session:
        assert record_recommendation(session, lease, None)
    body = {"material": "pellet", "scale": 2.0, "warm_start": [source]}
    answer = client.post("/v1/studies", json=body)
    assert answer.status_code == (422 if is_refused else 201)
    if is_refused:
        # 23, 26, ... 35: variance 22.5.
        assert "half the noise between runs (4.74342 deg, of earlier replicates)" in answer.text


@pytest.mark.parametrize(
    ("change", "allowed"),
    [
        ({"material": "coke"}, "its material is pellet, here it is coke"),
        ({"scale": 3.0}, "its scale is 2.0, here it is 3.0"),
        ({"fill_level": 0.5}, "its fill_level is 1.0, here it is 0.5"),
        ({"time_step": "paper"}, "its time_step is fast, here it is paper"),
        ({"fixed": {"particle_wall_restitution": 0.4}}, "all its other parameters alike"),
    ],
)
def test_a_warm_start_from_another_test_is_refused(
    client: TestClient, sqlite_database: Database, change: dict[str, Any], allowed: str
) -> None:
    source = a_finished_study(sqlite_database)
    body = {"material": "pellet", "scale": 2.0, "warm_start": [source], **change}
    refused = client.post("/v1/studies", json=body)
    assert refused.status_code == 422
    (error,) = refused.json()["errors"]
    assert (error["field"], error["value"]) == ("warm_start", source)
    assert allowed in error["allowed"]


def test_a_warm_start_from_a_study_that_still_runs_is_refused(
    client: TestClient, sqlite_database: Database
) -> None:
    source = a_study(sqlite_database)
    refused = client.post("/v1/studies", json={"material": "pellet", "scale": 2.0, "warm_start": [source]})
    assert "a study that is over; this one is running" in refused.json()["detail"]


def test_the_controls_over_http(client: TestClient, sqlite_database: Database) -> None:
    study_id = a_study(sqlite_database)
    at = f"/v1/studies/{study_id}"
    paused = client.post(f"{at}/pause")
    assert (paused.status_code, paused.json()["state"]) == (202, "paused")
    assert paused.json()["pause"] == {"reason": "user", "text": "Paused by the user.", "numbers": {}}
    assert client.post(f"{at}/resume").json()["pause"] is None
    assert client.post(f"{at}/budget", json={"budget": 40}).json()["budget"] == 40
    refused = client.post(f"{at}/budget", json={"budget": 4})
    assert (refused.status_code, refused.json()["errors"][0]["field"]) == (422, "budget")
    x = {PP: 0.5, ROLLING: 0.2, **FIXED}
    made = client.post(f"{at}/designs", json={"x": x}, headers={"Idempotency-Key": "once"})
    assert (made.status_code, made.json()["number"], made.json()["origin"]) == (201, 1, "manual")
    assert (
        client.post(f"{at}/designs", json={"x": x}, headers={"Idempotency-Key": "once"}).json()["number"] == 1
    )
    again = client.post(f"/v1/designs/{made.json()['id']}/rerun", json={})
    assert (again.status_code, again.json()["origin"]) == (201, "replicate")
    refused = client.post(f"/v1/designs/{made.json()['id']}/rerun", json={"same_seed": True})
    assert refused.status_code == 409
    assert refused.json()["detail"].startswith("Only a design that ended in error")
    assert client.post(f"{at}/cancel").json()["state"] == "cancelling"
    refused = client.post(f"{at}/pause")
    assert (refused.status_code, refused.json()["title"]) == (409, "Conflict")


@pytest.mark.parametrize(
    "path",
    ["studies/9/pause", "studies/9/resume", "studies/9/budget", "studies/9/designs", "designs/9/rerun"],
)
def test_controls_of_nothing(client: TestClient, path: str) -> None:
    body = {"budget": {"budget": 3}, "designs": {"x": {}}, "rerun": {}}.get(path.rpartition("/")[2])
    assert client.post(f"/v1/{path}", json=body).status_code == 404

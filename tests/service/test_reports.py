"""Reports: asked for, written by a worker, read, and sliced into ensembles."""

from __future__ import annotations

from fastapi.testclient import TestClient

from service.db.session import Database
from service.domain.outcome import Failure, FailureClass
from service.domain.states import JobKind, StudyState
from service.studies.pause_study import pause_study
from service.studies.record_failure import record_failure
from service.studies.request_report import request_report
from tests.builders.studies import (
    A_REPORT,
    a_finished_study,
    a_study,
    claimed,
    open_jobs,
    propose_next,
    simulate,
    study,
    write_report,
)


def test_a_report_is_written_when_a_study_ends_and_is_current(
    client: TestClient, sqlite_database: Database
) -> None:
    study_id = a_finished_study(sqlite_database)
    answer = client.get(f"/v1/studies/{study_id}/report").json()
    assert (answer["designs"], answer["is_current"], answer["code_version"]) == (3, True, "0123456789abcdef")
    assert answer["report"] == A_REPORT


def test_a_report_on_demand_grows_old(client: TestClient, sqlite_database: Database) -> None:
    study_id = a_study(sqlite_database, parallel=1)
    path = f"/v1/studies/{study_id}/report"
    missing = client.get(path)
    assert (missing.status_code, "asks for one" in missing.json()["detail"]) == (404, True)
    first, second = client.post(path), client.post(path)
    assert (first.status_code, first.json()["kind"]) == (202, "report")
    assert first.json()["id"] == second.json()["id"], "one at a time"
    propose_next(sqlite_database, study_id)
    write_report(sqlite_database, study_id)
    assert client.get(path).json()["is_current"]
    simulate(sqlite_database, open_jobs(sqlite_database, study_id)[0], 25.5)
    assert not client.get(path).json()["is_current"]


def test_a_report_holds_no_study_up_and_none_holds_it_up(database: Database) -> None:
    study_id = a_study(database)

    with database.writing() as session:
        request_report(session, study_id)
        pause_study(session, study_id)
    (job_id,) = open_jobs(database, study_id)
    lease = claimed(database, job_id).lease
    with database.writing() as session:
        assert record_failure(session, lease, Failure(FailureClass.ERROR, "singular"))
    assert study(database, study_id).state is StudyState.PAUSED, "a report that fails is missing, no more"
    assert open_jobs(database, study_id, JobKind.REPORT) == []


def test_an_ensemble_is_the_first_members(client: TestClient, sqlite_database: Database) -> None:
    at = f"/v1/studies/{a_finished_study(sqlite_database)}/ensemble"
    members = client.get(f"{at}?n=2").json()["members"]
    assert [member["x"] for member in members] == [{"rolling_resistance": 0.0}, {"rolling_resistance": 0.1}]
    assert "weight" not in members[0], "it would be another among two"
    assert client.get(f"{at}?n=5").json()["members"] == A_REPORT["ensemble"]["members"]
    refused = client.get(f"{at}?n=6")
    assert (refused.status_code, refused.json()["errors"][0]["allowed"]) == (
        422,
        "1 to 5, which the report has",
    )
    assert client.get(f"{at}?n=0").status_code == 422


def test_too_little_is_known_for_an_ensemble(client: TestClient, sqlite_database: Database) -> None:
    study_id = a_study(sqlite_database)
    client.post(f"/v1/studies/{study_id}/report")
    write_report(sqlite_database, study_id, {"enough": False, "text": "At least three designs are needed."})
    refused = client.get(f"/v1/studies/{study_id}/ensemble")
    assert (refused.status_code, "three designs" in refused.json()["detail"]) == (409, True)
    for path in ("report", "ensemble"):
        assert client.get(f"/v1/studies/99/{path}").status_code == 404
    assert client.post("/v1/studies/99/report").status_code == 404

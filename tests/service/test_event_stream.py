"""A study's events as server-sent events."""

from __future__ import annotations

import asyncio
import json
from dataclasses import dataclass
from typing import Any

from fastapi.testclient import TestClient

from service.api.events import look_at
from service.db import queries
from service.db.session import Database
from service.domain.history import StudyStop
from service.progress import StreamItem, follow
from service.studies.cancel_study import cancel_study
from service.studies.record_measurement import record_measurement
from service.studies.record_recommendation import record_recommendation
from tests.builders.studies import a_measurement, a_study, claimed, open_jobs, propose_next


@dataclass
class Event:
    id: int | None
    kind: str
    data: dict[str, Any]


def parse(text: str) -> list[Event]:
    found = []
    for block in text.strip().split("\n\n"):
        fields = dict(line.split(": ", 1) for line in block.split("\n") if not line.startswith(":"))
        if fields:
            number = int(fields["id"]) if "id" in fields else None
            found.append(Event(number, fields["event"], json.loads(fields["data"])))
    return found


def finished_study(database: Database) -> int:
    study_id = a_study(database, parallel=1)
    propose_next(database, study_id)
    (job_id,) = open_jobs(database, study_id)
    with database.writing() as session:
        record_measurement(session, claimed(database, job_id).lease, a_measurement(25.4))
    propose_next(database, study_id, StudyStop("certified", "Good.", {}))
    (job_id,) = open_jobs(database, study_id)
    with database.writing() as session:
        record_recommendation(session, claimed(database, job_id).lease, None)
    return study_id


def test_a_study_that_is_over_is_told_whole_and_the_stream_ends(
    client: TestClient, sqlite_database: Database
) -> None:
    study_id = finished_study(sqlite_database)
    response = client.get(f"/v1/studies/{study_id}/events")
    assert response.headers["content-type"].startswith("text/event-stream")
    events = parse(response.text)
    assert [event.kind for event in events] == [
        "study_created",
        "design_proposed",
        "design_started",
        "design_finished",
        "study_stopping",
        "study_finished",
    ]
    assert events[3].data["angle_deg"] == 25.4
    assert events[3].data["verdict"] == "feasible"
    assert events[-1].data["counters"] == {"feasible": 1, "unfeasible": 0, "error": 0}


def test_a_client_that_comes_back_gets_exactly_what_it_missed(
    client: TestClient, sqlite_database: Database
) -> None:
    study_id = finished_study(sqlite_database)
    events = parse(client.get(f"/v1/studies/{study_id}/events").text)
    for seen in range(len(events) - 1):
        headers = {"Last-Event-ID": str(events[seen].id)}
        again = parse(client.get(f"/v1/studies/{study_id}/events", headers=headers).text)
        assert again == events[seen + 1 :]


def test_a_client_that_has_all_of_it_is_told_to_stop_asking(
    client: TestClient, sqlite_database: Database
) -> None:
    study_id = finished_study(sqlite_database)
    last = parse(client.get(f"/v1/studies/{study_id}/events").text)[-1].id
    response = client.get(f"/v1/studies/{study_id}/events", headers={"Last-Event-ID": str(last)})
    assert response.status_code == 204


def test_other_studies_are_not_told(client: TestClient, sqlite_database: Database) -> None:
    first, second = finished_study(sqlite_database), finished_study(sqlite_database)
    for study_id in (first, second):
        events = parse(client.get(f"/v1/studies/{study_id}/events").text)
        assert {event.data["study_id"] for event in events if "study_id" in event.data} == {study_id}


def test_a_wrong_last_event_id_is_refused(client: TestClient, sqlite_database: Database) -> None:
    study_id = finished_study(sqlite_database)
    response = client.get(f"/v1/studies/{study_id}/events", headers={"Last-Event-ID": "yesterday"})
    assert response.status_code == 422


async def take(stream: Any, count: int) -> list[StreamItem]:
    return [await asyncio.wait_for(anext(stream), 5.0) for _ in range(count)]


def test_what_happens_next_and_progress_come_as_they_happen(database: Database) -> None:
    study_id = a_study(database)
    propose_next(database, study_id)
    (job_id,) = open_jobs(database, study_id)[:1]

    async def watch() -> None:
        stream = follow(look_at(database, study_id), after=0, poll_seconds=0.02)
        assert [item.kind for item in await take(stream, 2)] == ["study_created", "design_proposed"]
        claim = claimed(database, job_id)
        started, progress = await take(stream, 2)
        assert (started.kind, progress.kind, progress.id) == ("design_started", "progress", None)
        for fraction in (0.25, 0.5):
            with database.writing() as session:
                queries.beat(session, claim.lease, 10.0, {"fraction": fraction})
            (progress,) = await take(stream, 1)
            assert progress.data == {"number": 1, "attempt": 1, "fraction": fraction}
        with database.writing() as session:
            record_measurement(session, claim.lease, a_measurement(25.4))
        (finished,) = await take(stream, 1)
        assert finished.kind == "design_finished"
        await stream.aclose()

    asyncio.run(watch())


def test_the_stream_ends_with_the_study(database: Database) -> None:
    study_id = a_study(database)

    async def watch() -> list[str]:
        stream = follow(look_at(database, study_id), after=0, poll_seconds=0.02)
        kinds = [item.kind for item in await take(stream, 1)]
        with database.writing() as session:
            cancel_study(session, study_id)
        return kinds + [item.kind async for item in stream]

    assert asyncio.run(watch()) == ["study_created", "study_stopping", "study_finished"]

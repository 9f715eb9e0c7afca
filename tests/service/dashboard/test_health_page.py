"""The installation's page: processes, jobs, ends of attempts, room."""

from __future__ import annotations

from fastapi.testclient import TestClient

from service.dashboard.health_page import ENDS
from service.dashboard.words import FAILURES
from service.db.presence import report_presence
from service.db.session import Database
from service.domain.outcome import FailureClass
from service.settings import Settings
from service.studies.forgive_attempt import LATE
from tests.builders.charges import charges, finish_charge


def test_an_installation_without_anybody_says_what_to_do(client: TestClient) -> None:
    text = client.get("/health").text
    assert "No worker and no dispatcher has reported" in text and "make serve" in text
    assert "No job was asked for yet" in text and "None has ended" in text


def test_who_works_what_waits_and_how_attempts_ended(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    first, _second = charges(sqlite_database, seeds=(1, 2))
    settings.artifacts_dir.mkdir(parents=True, exist_ok=True)
    finish_charge(sqlite_database, first, settings)
    with sqlite_database.writing() as session:
        report_presence(session, "w", "worker", "plant-pc", 4711)
        report_presence(session, "d", "dispatcher", "plant-pc", 4712, "the broker does not answer")
    text = client.get("/health").text
    for told in ("plant-pc", "4711", "the broker does not answer", "Charge of the hopper", "Came to its end"):
        assert told in text, told
    assert "sqlite" in text and "Free on the disk" in text
    parts = client.get("/health/parts").json()["html"]
    assert set(parts) == {"health", "processes", "work"} and "plant-pc" in parts["processes"]


def test_no_secret_is_shown(client: TestClient, settings: Settings) -> None:
    text = client.get("/health").text
    assert str(settings.data_dir) not in text and settings.resolved_database_url not in text


def test_every_end_of_an_attempt_has_its_words() -> None:
    ends = {"done", "cancelled", "released", LATE, *(each.value for each in FailureClass)}
    assert ends == ends & {*ENDS, *FAILURES}

"""Prometheus reads what the tables say, in its own format."""

from __future__ import annotations

from fastapi.testclient import TestClient
from prometheus_client.parser import text_string_to_metric_families

from service.db.presence import report_presence
from service.db.session import Database
from tests.builders.studies import a_finished_study, a_study


def test_metrics_count_what_is_stored(client: TestClient, sqlite_database: Database) -> None:
    a_study(sqlite_database)
    a_finished_study(sqlite_database)
    with sqlite_database.writing() as session:
        report_presence(session, "w", "worker", "host", 1)
    answer = client.get("/metrics")
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/plain; version=")
    samples = {
        (sample.name, *sorted(sample.labels.values())): sample.value
        for family in text_string_to_metric_families(answer.text)
        for sample in family.samples
    }
    assert samples["talus_studies", "running"] == 1
    assert samples["talus_studies", "completed"] == 1
    assert samples["talus_jobs", "propose", "queued"] == 1
    assert samples["talus_jobs", "done", "simulate"] == 2
    assert samples["talus_attempts_total", "no_result"] == 1
    assert samples["talus_processes", "worker"] == 1
    assert samples["talus_processes", "dispatcher"] == 0
    assert 0 <= samples["talus_queue_wait_seconds",] < 600


def test_metrics_of_nothing(client: TestClient) -> None:
    assert "talus_queue_wait_seconds 0.0" in client.get("/metrics").text
